/** Standard deviations of a drawn ellipse: 99.7 % of a one-dimensional normal error. */
export const kSigmas = 3;

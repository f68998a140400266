/** What is drawn of a covariance: 99.7 % of a single normal error. */
export const kSigmas = 3;

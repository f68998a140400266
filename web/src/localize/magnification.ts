import { roundBelow } from './round.js';
import { kSigmas } from './sigmas.js';

/** Largest major half-axis of a drawn ellipse [m], which limits its magnification. */
const kShownEllipse_m = 4;

/** The magnification of a drawn ellipse, a round number. @param major_m one standard deviation along its major axis. */
export function magnification(major_m: number): number {
  return Math.max(1, roundBelow(kShownEllipse_m / (kSigmas * Math.max(major_m, 1e-6))));
}

import { roundBelow } from './round.js';
import { kSigmas } from './sigmas.js';

/** A round number of times an ellipse is enlarged, so that its long half is so long at most [m] and can be seen. */
const kShownEllipse_m = 4;

/** How much larger an ellipse is drawn than it is. @param major_m one deviation along its long half. */
export function magnification(major_m: number): number {
  return Math.max(1, roundBelow(kShownEllipse_m / (kSigmas * Math.max(major_m, 1e-6))));
}

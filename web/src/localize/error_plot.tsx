import { headingOf, type Pose } from './pose.js';
import { roundBelow } from './round.js';
import { kSigmas } from './sigmas.js';
import { uncertaintyOf } from './uncertainty.js';
import { angleWords, lengthWords } from './words.js';

interface Protection {
  longitudinal_m: number | null;
  lateral_m: number | null;
  vertical_m: number | null;
  yaw_rad: number | null;
}

/** Half the width of the drawing, in its own units. */
const kHalf = 100;
/** Share of the drawing that the largest shape fills. */
const kFill = 0.78;

const degrees = (radians: number): number => (radians * 180) / Math.PI;

/**
 * The uncertainty of the pose from above, north up: the ellipse of its covariance and, if the verdict is `ok`, the box
 * of its protection levels.
 */
export function ErrorPlot({ pose, covariance, protection }: { pose: Pose; covariance: readonly number[]; protection: Protection }) {
  const found = uncertaintyOf(pose, covariance);
  const { longitudinal_m: along, lateral_m: across } = protection;
  const reach_m = Math.max(kSigmas * found.major_m, along ?? 0, across ?? 0, 1e-4);
  const scale = (kFill * kHalf) / reach_m;
  const bar_m = roundBelow((0.7 * kHalf) / scale);
  const heading = -degrees(headingOf(pose));
  const words = `Ellipse of ${kSigmas} standard deviations: ${lengthWords(kSigmas * found.major_m)} by ${lengthWords(kSigmas * found.minor_m)}` +
    (along === null || across === null ? '.' : `; protection level ${lengthWords(along)} along and ${lengthWords(across)} across.`);
  return (
    <figure class="error-plot">
      <svg viewBox={`${-kHalf} ${-kHalf} ${2 * kHalf} ${2 * kHalf}`} role="img" aria-label={words}>
        <path class="axes" d={`M${-kHalf} 0H${kHalf}M0 ${-kHalf}V${kHalf}`} />
        {along !== null && across !== null && (
          <rect
            class="protection" x={-scale * along} y={-scale * across} width={2 * scale * along} height={2 * scale * across}
            transform={`rotate(${heading})`}
          />
        )}
        <ellipse
          class="ellipse" rx={scale * kSigmas * found.major_m} ry={scale * kSigmas * found.minor_m}
          transform={`rotate(${-degrees(found.angle_rad)})`}
        />
        <path class="heading" d="M9 0 L-7 6 L-3 0 L-7 -6 Z" transform={`rotate(${heading})`} />
        <g class="bar" transform={`translate(${-kHalf + 8} ${kHalf - 10})`}>
          <path d={`M0 -4V0H${scale * bar_m}V-4`} />
          <text x={scale * bar_m + 6} y="1">{lengthWords(bar_m)}</text>
        </g>
      </svg>
      <figcaption>
        <p><span class="key ellipse" /> {kSigmas}σ: {lengthWords(kSigmas * found.major_m)} × {lengthWords(kSigmas * found.minor_m)}</p>
        <p class="quiet">Height {lengthWords(kSigmas * found.vertical_m)}, heading {angleWords(kSigmas * found.yaw_rad)} (3σ)</p>
        {along !== null && across !== null && (
          <>
            <p><span class="key protection" /> Protection level: {lengthWords(along)} along, {lengthWords(across)} across</p>
            <p class="quiet">Height {lengthWords(protection.vertical_m)}, heading {angleWords(protection.yaw_rad)}; exceeded once in a thousand</p>
          </>
        )}
        {along === null && <p class="quiet">No protection level: only poses with the verdict “Found” have one.</p>}
      </figcaption>
    </figure>
  );
}

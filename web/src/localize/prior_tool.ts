import type { PointerPlace, Tool } from '../scene/pointers.js';
import type { Pose, Vec3 } from './pose.js';
import { priorAt, usualHeading } from './prior.js';

/** A drag shorter than this says nothing about where the sensor looked [m]. */
const kLeastDrag_m = 0.5;

/**
 * Press where the sensor was, drag to where it looked.
 *
 * @param poses   that the map was recorded from: height, slope and, without a drag, heading come from them.
 * @param show    told with the prior as it stands; `settled` once the drag has ended.
 * @param done    the drag has ended, or was given up.
 */
export function priorTool(poses: readonly Pose[], show: (prior: Pose, settled: boolean) => void, done: () => void): Tool {
  let ground: Vec3 | undefined;
  let prior: Pose | undefined;
  const look = (place: PointerPlace, settled: boolean): void => {
    if (ground === undefined) return;
    const end = place.pick()?.position ?? ground;
    const [dx, dy] = [end[0] - ground[0], end[1] - ground[1]];
    const angle = Math.hypot(dx, dy) < kLeastDrag_m ? usualHeading(ground, poses) : Math.atan2(dy, dx);
    prior = priorAt(ground, angle, poses);
    show(prior, settled);
  };
  return {
    cursor: 'crosshair',
    down: (place) => {
      ground = place.pick()?.position as Vec3 | undefined;
      look(place, false);
      return ground !== undefined;
    },
    move: (place) => look(place, false),
    up: (place) => {
      look(place, true);
      ground = undefined;
      done();
    },
    cancel: () => {
      ground = undefined;
      done();
    },
  };
}

import type { PointerPlace, Tool } from '../scene/pointers.js';
import type { Pose, Vec3 } from './pose.js';
import { priorAt, usualHeading } from './prior.js';

/** A shorter drag gives no direction [m]. */
const kLeastDrag_m = 0.5;

/**
 * Sets a prior: press where the sensor was, and drag in the direction it faced.
 *
 * @param poses   from which the map was recorded. They give height, slope and, without a drag, the heading.
 * @param show    called with the present prior; `final` when the drag has ended.
 * @param done    called when the drag has ended or was cancelled.
 */
export function priorTool(poses: readonly Pose[], show: (prior: Pose, final: boolean) => void, done: () => void): Tool {
  let ground: Vec3 | undefined;
  let prior: Pose | undefined;
  const look = (place: PointerPlace, final: boolean): void => {
    if (ground === undefined) return;
    const end = place.pick()?.position ?? ground;
    const [dx, dy] = [end[0] - ground[0], end[1] - ground[1]];
    const angle = Math.hypot(dx, dy) < kLeastDrag_m ? usualHeading(ground, poses) : Math.atan2(dy, dx);
    prior = priorAt(ground, angle, poses);
    show(prior, final);
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

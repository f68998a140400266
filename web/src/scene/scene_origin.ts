import type { Vec3 } from './types.js';

/** Box around a map's points, relative to its origin [m]. */
export interface MapBounds {
  readonly min: readonly number[];
  readonly max: readonly number[];
}

/**
 * Where the picture of a map has its origin: in the middle of its points, because a graphics card computes in floats, which
 * grow coarse far from it. Heights count from the map's origin.
 *
 * @param origin of the map. @param bounds undefined when it has no points.
 * @returns map coordinates [m], a whole number of metres from the map's origin.
 */
export function sceneOrigin(origin: Vec3, bounds: MapBounds | undefined): Vec3 {
  const middle = (axis: 0 | 1): number =>
    bounds === undefined ? 0 : Math.round(((bounds.min[axis] as number) + (bounds.max[axis] as number)) / 2);
  return [origin[0] + middle(0), origin[1] + middle(1), origin[2]];
}

import type { Vec3 } from './types.js';

/**
 * Where the picture of a map has its origin: in the middle of its tiles, because a graphics card computes in floats, which
 * grow coarse far from it. Heights count from the map's origin.
 *
 * @param origin of the map. @param tiles with bounds relative to that.
 * @returns map coordinates [m], a whole number of metres from the map's origin.
 */
export function sceneOrigin(origin: Vec3, tiles: readonly { readonly min: readonly number[]; readonly max: readonly number[] }[]): Vec3 {
  const middle = (axis: 0 | 1): number => {
    let [low, high] = [Infinity, -Infinity];
    for (const { min, max } of tiles) {
      low = Math.min(low, min[axis] as number);
      high = Math.max(high, max[axis] as number);
    }
    return low <= high ? Math.round((low + high) / 2) : 0;
  };
  return [origin[0] + middle(0), origin[1] + middle(1), origin[2]];
}

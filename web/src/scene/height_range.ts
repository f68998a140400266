import type { MapCloud } from './map_cloud.js';
import type { Vec3 } from './types.js';

/**
 * Colours clouds by one range of heights, that of the first of them that knows its own: call it as they change.
 *
 * @param origin of the scene, from which its heights count.
 * @return whether a range is known.
 */
export function shareHeights(clouds: readonly MapCloud[], origin: Vec3): boolean {
  const height = clouds.find((cloud) => cloud.ranges !== undefined)?.ranges?.height;
  if (height === undefined) return false;
  const range = { low: height.low - origin[2], high: height.high - origin[2] };
  for (const cloud of clouds) cloud.materials.setRange('height', range);
  return true;
}

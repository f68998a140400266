import type { MapCloud } from './map_cloud.js';
import type { Vec3 } from './types.js';

/**
 * Colours all clouds by the height range of the first cloud that has one. Call it when a cloud changes.
 *
 * @param origin of the scene, to which heights are relative.
 * @return whether a range is known.
 */
export function shareHeights(clouds: readonly MapCloud[], origin: Vec3): boolean {
  const height = clouds.find((cloud) => cloud.ranges !== undefined)?.ranges?.height;
  if (height === undefined) return false;
  const range = { low: height.low - origin[2], high: height.high - origin[2] };
  for (const cloud of clouds) cloud.materials.setRange('height', range);
  return true;
}

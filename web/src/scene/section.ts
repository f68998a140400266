import type { Box } from './clip_box.js';
import { coordinateOf, type Points } from './point_layout.js';
import type { Vec3 } from './types.js';

/** A vertical cut through the map from `from` to `to`, `width` [m] thick; heights from `low` to `high` [m]. */
export interface Section {
  readonly from: Vec3;
  readonly to: Vec3;
  readonly width: number;
  readonly low: number;
  readonly high: number;
}

/** Points seen from the side: metres along the cut, heights [m], kinds. */
export interface Profile {
  readonly along: Float64Array;
  readonly heights: Float64Array;
  readonly kinds: Uint8Array;
}

/** Horizontal length of the cut [m]. */
export function lengthOf({ from, to }: Section): number {
  return Math.hypot(to[0] - from[0], to[1] - from[1]);
}

/** The box that the cut's points lie in. */
export function boxOf(section: Section): Box {
  const { from, to, low, high } = section;
  return {
    centre: [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2, (low + high) / 2],
    size: [lengthOf(section), section.width, high - low],
    yaw: Math.atan2(to[1] - from[1], to[0] - from[0]),
  };
}

/**
 * The points of the cut, from the side: `along` runs from 0 at `from` to the length at `to`.
 *
 * @param section  relative to the map's origin, as the tiles' corners.
 * @param holds  which kinds are wanted, by index in kKinds.
 * @throws RangeError when both ends are the same place.
 */
export function profileOf(section: Section, tiles: readonly Points[], holds: (kind: number) => boolean): Profile {
  const length = lengthOf(section);
  if (!(length > 0)) throw new RangeError('section: both ends are the same place, expected two');
  const [ux, uy] = [(section.to[0] - section.from[0]) / length, (section.to[1] - section.from[1]) / length];
  const [along, heights, kinds]: [number[], number[], number[]] = [[], [], []];
  for (const tile of tiles) {
    const { kinds: kindOf } = tile;
    for (let i = 0; i < tile.count; ++i) {
      const [x, y, z] = [coordinateOf(tile, i, 0), coordinateOf(tile, i, 1), coordinateOf(tile, i, 2)];
      if (z < section.low || z > section.high || !holds(kindOf[i] as number)) continue;
      const [dx, dy] = [x - section.from[0], y - section.from[1]];
      const at = ux * dx + uy * dy;
      if (at < 0 || at > length || 2 * Math.abs(ux * dy - uy * dx) > section.width) continue;
      along.push(at);
      heights.push(z);
      kinds.push(kindOf[i] as number);
    }
  }
  return { along: Float64Array.from(along), heights: Float64Array.from(heights), kinds: Uint8Array.from(kinds) };
}

/** Lowest and highest height; undefined if the cut has no points. */
export function extentOf({ heights }: Profile): [number, number] | undefined {
  let [low, high] = [Infinity, -Infinity];
  for (const height of heights) {
    low = Math.min(low, height);
    high = Math.max(high, height);
  }
  return low <= high ? [low, high] : undefined;
}

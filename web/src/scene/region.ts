import { corners, mayTouch, type Box } from './clip_box.js';
import { cornerOf, readPoints, type Points } from './point_layout.js';
import type { Vec3 } from './types.js';

/** A tile of full resolution; bounds [m] relative to the map's origin. */
export interface RegionTile {
  readonly level: number;
  readonly x: number;
  readonly y: number;
  readonly points: number;
  readonly min: readonly number[];
  readonly max: readonly number[];
}

/** Most points that are loaded into the browser at once: some 400 MB. */
export const kRegionLimit = 20_000_000;
const kAtOnce = 4;

/** What a box covers of the ground. */
export function areaOf(box: Box): { min: [number, number]; max: [number, number] } {
  const [xs, ys] = [0, 1].map((axis) => corners(box).map((corner) => corner[axis] as number)) as [number[], number[]];
  return { min: [Math.min(...xs), Math.min(...ys)], max: [Math.max(...xs), Math.max(...ys)] };
}

/** Tiles of full resolution that may have points in the box (relative to the map's origin); all without one. */
export function tilesOf(tiles: readonly RegionTile[], box: Box | undefined): RegionTile[] {
  return tiles.filter(({ level, min, max }) =>
    level === 0 && (box === undefined || mayTouch(box, min as unknown as Vec3, max as unknown as Vec3)));
}

/**
 * Loads tiles in full resolution.
 *
 * @param get    the bytes of a tile.
 * @param onTile called after each tile with their number so far and in total.
 * @throws Error when they have more than kRegionLimit points, or one is damaged; what `get` throws.
 */
export async function fetchRegion(
  tiles: readonly RegionTile[], get: (tile: RegionTile) => Promise<ArrayBuffer>, onTile: (done: number, of: number) => void,
): Promise<Points[]> {
  const total = tiles.reduce((sum, tile) => sum + tile.points, 0);
  if (total > kRegionLimit) {
    throw new Error(`The export has ${total.toLocaleString('en-GB')} points, more than the ${kRegionLimit.toLocaleString('en-GB')} ` +
      'points that a browser can export. Make the box smaller, or use “stillmap export”.');
  }
  const found = new Array<Points>(tiles.length);
  let [next, done] = [0, 0];
  const lane = async (): Promise<void> => {
    while (next < tiles.length) {
      const number = next++;
      const tile = tiles[number] as RegionTile;
      const bytes = await get(tile);
      try {
        found[number] = readPoints(bytes, cornerOf(tile), tile.points);
      } catch (error) {
        throw new Error(`Tile ${tile.level}/${tile.x}/${tile.y} is damaged: ${(error as Error).message}. Try again, or check the version with “stillmap store verify”.`);
      }
      onTile(++done, tiles.length);
    }
  };
  await Promise.all(Array.from({ length: Math.min(kAtOnce, tiles.length) }, lane));
  return found;
}

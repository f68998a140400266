import type { Vec3 } from '../scene/types.js';

/** A point further away than this counts as not in the map [m]. */
export const kMaxResidual_m = 0.5;
const kCell_m = 0.5;
// Cells of a map of 30 km fit; three of them make one exact whole number below 2^53.
const kHalfSide = 1 << 16;

const cellKey = (x: number, y: number, z: number): number =>
  ((x + kHalfSide) * 2 * kHalfSide + (y + kHalfSide)) * 2 * kHalfSide + (z + kHalfSide);

/** Points of a map, to find the distance of scan points to them. */
export class MapPoints {
  private readonly cells = new Map<number, number[]>();

  /** @param positions x, y, z one after the other [m]. @param from what they count from; a place near it is zero. */
  add(positions: ArrayLike<number>, from: Vec3): void {
    for (let i = 0; i + 2 < positions.length; i += 3) {
      const [x, y, z] = [positions[i]! + from[0], positions[i + 1]! + from[1], positions[i + 2]! + from[2]];
      const key = cellKey(Math.floor(x / kCell_m), Math.floor(y / kCell_m), Math.floor(z / kCell_m));
      const cell = this.cells.get(key);
      if (cell === undefined) this.cells.set(key, [x, y, z]);
      else cell.push(x, y, z);
    }
  }

  /** @returns distance to the nearest point of the map [m], at most `kMaxResidual_m`. */
  residual(x: number, y: number, z: number): number {
    let least2 = kMaxResidual_m * kMaxResidual_m;
    const [cx, cy, cz] = [Math.floor(x / kCell_m), Math.floor(y / kCell_m), Math.floor(z / kCell_m)];
    for (let dx = -1; dx <= 1; ++dx) {
      for (let dy = -1; dy <= 1; ++dy) {
        for (let dz = -1; dz <= 1; ++dz) {
          least2 = nearest2(this.cells.get(cellKey(cx + dx, cy + dy, cz + dz)), x, y, z, least2);
        }
      }
    }
    return Math.sqrt(least2);
  }
}

function nearest2(cell: readonly number[] | undefined, x: number, y: number, z: number, least2: number): number {
  if (cell === undefined) return least2;
  for (let i = 0; i < cell.length; i += 3) {
    const distance2 = (cell[i]! - x) ** 2 + (cell[i + 1]! - y) ** 2 + (cell[i + 2]! - z) ** 2;
    if (distance2 < least2) least2 = distance2;
  }
  return least2;
}

const kPointBytes = 20;

/** Coordinates of a tile as the server sends it: 20 bytes a point, float32 x, y, z first. */
export function tilePositions(bytes: ArrayBuffer): Float32Array {
  const view = new DataView(bytes);
  const points = Math.floor(bytes.byteLength / kPointBytes);
  const positions = new Float32Array(3 * points);
  for (let i = 0; i < 3 * points; ++i) {
    positions[i] = view.getFloat32(Math.floor(i / 3) * kPointBytes + 4 * (i % 3), true);
  }
  return positions;
}

interface TilePlace {
  level: number;
  x: number;
  y: number;
}

/**
 * Tiles of level 0 whose square comes within a radius of a place.
 *
 * @param place  relative to the map's origin [m].
 */
export function tilesAround<Tile extends TilePlace>(tiles: readonly Tile[], place: readonly [number, number], radius_m: number, size_m: number): Tile[] {
  const gap = (value: number, index: number): number => {
    const low = index * size_m;
    return Math.max(low - value, 0, value - low - size_m);
  };
  return tiles.filter((tile) => tile.level === 0 && Math.hypot(gap(place[0], tile.x), gap(place[1], tile.y)) <= radius_m);
}

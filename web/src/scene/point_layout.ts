import { kKinds, type Vec3 } from './types.js';

/** Bytes of one point: float32 x, y, z, intensity; uint16 observations; uint8 kind; uint8 object; little endian. */
export const kPointBytes = 20;
/** The same in 4-byte words, and the word that holds observations, kind and object. */
export const kPointWords = 5;
export const kFactsWord = 4;

const kTileSizeM = 20;

/** Where a tile's coordinates count from: relative to the map's origin [m]. */
export function cornerOf({ level, x, y }: { readonly level: number; readonly x: number; readonly y: number }): Vec3 {
  return [x * kTileSizeM * 2 ** level, y * kTileSizeM * 2 ** level, 0];
}

/** Points of a tile, as columns; coordinates [m] relative to its corner. */
export interface Points {
  readonly count: number;
  /** Relative to the map's origin [m]. */
  readonly corner: Vec3;
  /** x, y, z one after the other. */
  readonly positions: Float32Array;
  readonly intensities: Float32Array;
  readonly observations: Uint16Array;
  /** Index in kKinds. */
  readonly kinds: Uint8Array;
}

/**
 * Reads a tile of the server.
 *
 * @param corner of the tile.
 * @throws Error when the size is no multiple of 20, or is not that of `expectedPoints` where
 *         given, a coordinate is not finite or a kind is unknown.
 */
export function readPoints(bytes: ArrayBuffer, corner: Vec3, expectedPoints?: number): Points {
  const count = expectedPoints ?? Math.floor(bytes.byteLength / kPointBytes);
  if (bytes.byteLength !== count * kPointBytes) {
    throw new Error(`has ${bytes.byteLength} bytes, expected ${count * kPointBytes} (${count} points of ${kPointBytes} bytes)`);
  }
  const points = emptyPoints(count, corner);
  const view = new DataView(bytes);
  for (let i = 0; i < count; ++i) {
    const at = i * kPointBytes;
    for (let axis = 0; axis < 3; ++axis) {
      const value = view.getFloat32(at + 4 * axis, true);
      if (!Number.isFinite(value)) throw new Error(`point ${i}: coordinate ${'xyz'.charAt(axis)} is not finite`);
      points.positions[3 * i + axis] = value;
    }
    points.intensities[i] = view.getFloat32(at + 12, true);
    points.observations[i] = view.getUint16(at + 16, true);
    const kind = view.getUint8(at + 18);
    if (kind >= kKinds.length) throw new Error(`point ${i}: kind ${kind} is unknown, expected 0 to ${kKinds.length - 1}`);
    points.kinds[i] = kind;
  }
  return points;
}

/** A coordinate of a point relative to the map's origin [m]: in doubles, since far away it is too large for floats. */
export function coordinateOf({ positions, corner }: Points, point: number, axis: 0 | 1 | 2): number {
  return corner[axis] + (positions[3 * point + axis] as number);
}

function emptyPoints(count: number, corner: Vec3): Points {
  return {
    count,
    corner,
    positions: new Float32Array(3 * count),
    intensities: new Float32Array(count),
    observations: new Uint16Array(count),
    kinds: new Uint8Array(count),
  };
}

/** The points of a tile that `holds`, in their order. */
export function select(tile: Points, holds: (point: number) => boolean): Points {
  const indices: number[] = [];
  for (let i = 0; i < tile.count; ++i) if (holds(i)) indices.push(i);
  const kept = emptyPoints(indices.length, tile.corner);
  indices.forEach((from, to) => {
    kept.positions.set(tile.positions.subarray(3 * from, 3 * from + 3), 3 * to);
    kept.intensities[to] = tile.intensities[from] as number;
    kept.observations[to] = tile.observations[from] as number;
    kept.kinds[to] = tile.kinds[from] as number;
  });
  return kept;
}

import { kKinds } from './types.js';

/** Bytes of one point: float32 x, y, z, intensity; uint16 observations; uint8 kind; uint8 object; little endian. */
export const kPointBytes = 20;
/** The same in 4-byte words, and the word that holds observations, kind and object. */
export const kPointWords = 5;
export const kFactsWord = 4;

/** Points of a tile, as columns; coordinates [m] relative to the map's origin. */
export interface Points {
  readonly count: number;
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
 * @throws Error when the size is no multiple of 20, or is not that of `expectedPoints` where
 *         given, a coordinate is not finite or a kind is unknown.
 */
export function readPoints(bytes: ArrayBuffer, expectedPoints?: number): Points {
  const count = expectedPoints ?? Math.floor(bytes.byteLength / kPointBytes);
  if (bytes.byteLength !== count * kPointBytes) {
    throw new Error(`has ${bytes.byteLength} bytes, expected ${count * kPointBytes} (${count} points of ${kPointBytes} bytes)`);
  }
  const points = emptyPoints(count);
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

function emptyPoints(count: number): Points {
  return {
    count,
    positions: new Float32Array(3 * count),
    intensities: new Float32Array(count),
    observations: new Uint16Array(count),
    kinds: new Uint8Array(count),
  };
}

/** The points that `holds`, of several tiles, in their order. */
export function select(tiles: readonly Points[], holds: (tile: Points, point: number) => boolean): Points {
  const kept = tiles.map((tile) => {
    const indices: number[] = [];
    for (let i = 0; i < tile.count; ++i) if (holds(tile, i)) indices.push(i);
    return indices;
  });
  const all = emptyPoints(kept.reduce((sum, indices) => sum + indices.length, 0));
  let to = 0;
  tiles.forEach((tile, number) => {
    for (const from of kept[number] as number[]) {
      all.positions.set(tile.positions.subarray(3 * from, 3 * from + 3), 3 * to);
      all.intensities[to] = tile.intensities[from] as number;
      all.observations[to] = tile.observations[from] as number;
      all.kinds[to] = tile.kinds[from] as number;
      ++to;
    }
  });
  return all;
}

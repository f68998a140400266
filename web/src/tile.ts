/** Bytes of one point: float32 x, y, z, intensity; uint16 observations; uint8 kind; uint8 object. */
export const kPointBytes = 20;

/** What can be switched on its own. `filled` ground belongs to `projected`: neither was measured where it lies. */
export type Layer = 'measured' | 'ground' | 'projected';
export const kLayers: readonly Layer[] = ['measured', 'ground', 'projected'];

const kLayerOfKind: readonly Layer[] = ['measured', 'ground', 'projected', 'projected'];

/** Points of one tile by layer: x, y, z [m] one after the other, relative to the map's origin. */
export type TilePoints = Record<Layer, Float32Array>;

/**
 * Decodes a tile as the server sends it (little endian).
 *
 * @param expectedPoints what the map's manifest says, so that a cut-off answer is noticed.
 * @throws Error in words when the size is no multiple of 20 or differs from the manifest, a coordinate
 *         is not finite or a kind is unknown.
 */
export function decodeTile(bytes: ArrayBuffer, expectedPoints: number): TilePoints {
  if (bytes.byteLength !== expectedPoints * kPointBytes) {
    throw new Error(
      `has ${bytes.byteLength} bytes, expected ${expectedPoints * kPointBytes} ` +
        `(${expectedPoints} points of ${kPointBytes} bytes)`,
    );
  }
  const view = new DataView(bytes);
  const counts = countLayers(view, expectedPoints);
  const points: TilePoints = {
    measured: new Float32Array(3 * counts.measured),
    ground: new Float32Array(3 * counts.ground),
    projected: new Float32Array(3 * counts.projected),
  };
  const filled: Record<Layer, number> = { measured: 0, ground: 0, projected: 0 };
  for (let i = 0; i < expectedPoints; ++i) {
    const layer = layerOf(view, i);
    for (let axis = 0; axis < 3; ++axis) {
      const value = view.getFloat32(i * kPointBytes + 4 * axis, true);
      if (!Number.isFinite(value)) {
        throw new Error(`point ${i}: coordinate ${'xyz'.charAt(axis)} is not finite`);
      }
      points[layer][filled[layer]++] = value;
    }
  }
  return points;
}

function layerOf(view: DataView, point: number): Layer {
  const kind = view.getUint8(point * kPointBytes + 18);
  const layer = kLayerOfKind[kind];
  if (layer === undefined) throw new Error(`point ${point}: kind ${kind} is unknown, expected 0 to 3`);
  return layer;
}

function countLayers(view: DataView, points: number): Record<Layer, number> {
  const counts: Record<Layer, number> = { measured: 0, ground: 0, projected: 0 };
  for (let i = 0; i < points; ++i) ++counts[layerOf(view, i)];
  return counts;
}

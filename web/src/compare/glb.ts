const kPointBytes = 20;
const kMagic = 0x46546c67;
const kJsonChunk = 0x4e4f534a;
const kBinaryChunk = 0x004e4942;
const kHeaderBytes = 12;

/** Points of a tile, z up. */
export interface GlbPoints {
  /** x, y, z of each point in turn, relative to the corner [m]. */
  readonly positions: Float32Array;
  /** Relative to the origin that the route gives [m]. */
  readonly corner: [number, number, number];
}

/**
 * A tile as the server writes it: a GLB whose binary part is points of 20 bytes, float32 x, y, z first. The matrix of the
 * file's node places them, and turns them for glTF viewers.
 *
 * @throws Error if the bytes are not such a file.
 */
export function glbPoints(bytes: ArrayBuffer): GlbPoints {
  const view = new DataView(bytes);
  if (bytes.byteLength < kHeaderBytes || view.getUint32(0, true) !== kMagic) throw new Error('The server sent a tile that is not a GLB file. Check its version.');
  let corner: [number, number, number] | undefined;
  for (let at = kHeaderBytes; at + 8 <= bytes.byteLength;) {
    const [length, kind] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
    at += 8;
    if (at + length > bytes.byteLength) break;
    if (kind === kJsonChunk) corner = cornerIn(new TextDecoder().decode(new Uint8Array(bytes, at, length)));
    if (kind === kBinaryChunk && corner !== undefined) return { positions: positionsIn(new DataView(bytes, at, length)), corner };
    at += length;
  }
  throw new Error('The server sent a GLB file without points. Check its version.');
}

// The node's matrix is column after column; glTF has y up.
function cornerIn(json: string): [number, number, number] | undefined {
  const matrix = (JSON.parse(json) as { nodes?: { matrix?: number[] }[] }).nodes?.[0]?.matrix;
  return matrix?.length === 16 ? [matrix[12]!, -matrix[14]!, matrix[13]!] : undefined;
}

function positionsIn(points: DataView): Float32Array {
  const count = Math.floor(points.byteLength / kPointBytes);
  const positions = new Float32Array(3 * count);
  for (let i = 0; i < count; ++i) {
    for (let axis = 0; axis < 3; ++axis) positions[3 * i + axis] = points.getFloat32(kPointBytes * i + 4 * axis, true);
  }
  return positions;
}

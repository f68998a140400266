const kPointBytes = 20;
const kMagic = 0x46546c67;
const kBinaryChunk = 0x004e4942;
const kHeaderBytes = 12;

/**
 * Coordinates of a tile as the server writes it: a GLB whose binary part is points of 20 bytes, float32 x, y, z first.
 *
 * They are as in the file, z up; the matrix of the file's node turns them for glTF viewers.
 * @returns x, y, z of each point in turn, relative to the origin that the route gives [m].
 * @throws Error if the bytes are not such a file.
 */
export function glbPositions(bytes: ArrayBuffer): Float32Array {
  const view = new DataView(bytes);
  if (bytes.byteLength < kHeaderBytes || view.getUint32(0, true) !== kMagic) throw new Error('The server sent a tile that is not a GLB file. Check its version.');
  for (let at = kHeaderBytes; at + 8 <= bytes.byteLength;) {
    const [length, kind] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
    at += 8;
    if (at + length > bytes.byteLength) break;
    if (kind === kBinaryChunk) return positionsIn(new DataView(bytes, at, length));
    at += length;
  }
  throw new Error('The server sent a GLB file without points. Check its version.');
}

function positionsIn(points: DataView): Float32Array {
  const count = Math.floor(points.byteLength / kPointBytes);
  const positions = new Float32Array(3 * count);
  for (let i = 0; i < count; ++i) {
    for (let axis = 0; axis < 3; ++axis) positions[3 * i + axis] = points.getFloat32(kPointBytes * i + 4 * axis, true);
  }
  return positions;
}

import { decodePcd } from './pcd.js';
import { decodePly } from './ply.js';
import { checkPointCount, kExportAgain, kScanLimits, ScanError, usablePoints, type ScanLimits, type ScanPoints } from './scan_points.js';

/** A scan that can be shown, and the bytes that go to the server. */
export interface ScanFile extends ScanPoints {
  name: string;
  body: Uint8Array<ArrayBuffer>;
  contentType: 'application/octet-stream' | 'application/vnd.pcd';
  /** Of raw scans. */
  layout: 'xyz' | 'xyzi' | null;
}

/** @throws ScanError when the file is too large to be a scan; to be asked before its bytes are read. */
export function checkSize({ name, size }: File, limits: ScanLimits = kScanLimits): void {
  if (size > limits.maxBytes) {
    throw new ScanError(name, `it has ${size} bytes, and a scan may have ${limits.maxBytes}`, 'Choose a single scan, not a map or a whole drive');
  }
}

/**
 * Reads a scan by its contents. A file without a header is raw float32 if its name ends in `.bin`.
 *
 * PCD and raw scans go to the server unchanged. The server does not accept PLY: of that, raw coordinates are sent.
 * @throws ScanError that says what is wrong and what to do.
 */
export function readScanFile(name: string, bytes: ArrayBuffer, limits: ScanLimits = kScanLimits): ScanFile {
  const body = new Uint8Array(bytes);
  const begin = new TextDecoder('latin1').decode(body.subarray(0, 2048));
  if (/^ply\s/.test(begin)) {
    const points = decodePly(body, name, limits);
    return {
      name, ...points, body: new Uint8Array(points.positions.buffer),
      contentType: 'application/octet-stream', layout: 'xyz',
    };
  }
  if (/^(VERSION|FIELDS|COLUMNS) /m.test(begin)) {
    return { name, ...decodePcd(body, name, limits), body, contentType: 'application/vnd.pcd', layout: null };
  }
  if (/\.bin$/i.test(name)) return { name, ...decodeRaw(body, name, limits), body, contentType: 'application/octet-stream' };
  throw new ScanError(name, 'it has neither a PCD nor a PLY header', 'Choose a .pcd or .ply file, or a .bin file of float32 x y z intensity');
}

/** x y z intensity as in KITTI, or x y z if the size allows only that. */
function decodeRaw(
  bytes: Uint8Array<ArrayBuffer>, file: string, limits: ScanLimits,
): ScanPoints & { layout: 'xyz' | 'xyzi' } {
  const stride = [16, 12].find((size) => bytes.length % size === 0);
  if (bytes.length === 0 || stride === undefined) {
    throw new ScanError(file, `it has ${bytes.length} bytes, which is not a multiple of 16 (float32 x y z intensity) or 12 (x y z)`, kExportAgain);
  }
  checkPointCount(file, bytes.length / stride, limits);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const xyz = new Float32Array((3 * bytes.length) / stride);
  for (let at = 0, to = 0; at < bytes.length; at += stride) {
    for (let axis = 0; axis < 3; ++axis) xyz[to++] = view.getFloat32(at + 4 * axis, true);
  }
  return { ...usablePoints(xyz), layout: stride === 16 ? 'xyzi' : 'xyz' };
}

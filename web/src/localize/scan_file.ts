import { decodePcd } from './pcd.js';
import { decodePly } from './ply.js';
import { kScanLimits, checkPointCount, PointCollector, ScanError } from './scan_points.js';
import type { ScanLimits, ScanPoints } from './scan_points.js';

/** A scan that can be shown, and the bytes that go to the server. */
export interface ScanFile extends ScanPoints {
  name: string;
  body: Uint8Array<ArrayBuffer>;
  contentType: 'application/octet-stream' | 'application/vnd.pcd';
  /** Of raw scans. */
  layout: 'xyz' | 'xyzi' | null;
}

/**
 * Reads a scan by what it holds; a file without a header is raw float32 if it is named `.bin`.
 *
 * PCD and raw scans go to the server as they are; PLY, which it does not take, as raw coordinates.
 * @throws ScanError in words.
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
  throw new ScanError(name, 'neither a PCD nor a PLY header', 'a scan: .pcd, .ply, or .bin with float32 x y z intensity');
}

/** x y z intensity as KITTI has it, or x y z where the size allows only that. */
function decodeRaw(
  bytes: Uint8Array<ArrayBuffer>, file: string, limits: ScanLimits,
): ScanPoints & { layout: 'xyz' | 'xyzi' } {
  const stride = [16, 12].find((size) => bytes.length % size === 0);
  if (bytes.length === 0 || stride === undefined) {
    throw new ScanError(file, `${bytes.length} bytes`, 'a multiple of 16 (float32 x y z intensity) or 12 (x y z)');
  }
  const count = bytes.length / stride;
  checkPointCount(file, count, limits);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const points = new PointCollector(count);
  for (let at = 0; at < bytes.length; at += stride) {
    points.add(view.getFloat32(at, true), view.getFloat32(at + 4, true), view.getFloat32(at + 8, true));
  }
  return { ...points.finish(), layout: stride === 16 ? 'xyzi' : 'xyz' };
}

import { PLYLoader } from 'three/examples/jsm/loaders/PLYLoader.js';
import {
  checkPointCount, joined, kExportAgain, loadedPoints, numbersText, ScanError, type ScanLimits, type ScanPoints,
} from './scan_points.js';

const kMaxHeaderBytes = 65_536;
const kSaveAgain = 'Save the scan as PLY with float x, y and z, for example with Open3D or CloudCompare';

/**
 * Reads the coordinates of a PLY file's element `vertex` with three.js: ascii, or binary of either byte order.
 *
 * The loader trusts the header, so that is checked first. The loader gets a plain header: the elements up to `vertex`,
 * and of that one x, y and z under their names.
 * @throws ScanError when the file is not a PLY file, is incomplete, or has more points than allowed.
 */
export function decodePly(bytes: Uint8Array<ArrayBuffer>, file: string, limits: ScanLimits): ScanPoints {
  const text = new TextDecoder('latin1').decode(bytes.subarray(0, kMaxHeaderBytes));
  const end = /^end_header[ \t\r]*\n/m.exec(text);
  if (end === null) throw new ScanError(file, 'its header has no end_header line', kExportAgain);
  const lines = text.slice(0, end.index).split('\n').map((line) => line.trim()).filter((line) => !/^(comment|obj_info|ply)\b|^$/.test(line));
  const body = bytes.subarray(end.index + end[0].length);
  const { header, count } = plainHeader(lines, body.length, file);
  checkPointCount(file, count, limits);
  if (/^format ascii/m.test(header)) numbersText(file, body);
  return loadedPoints(file, count, () => new PLYLoader().parse(joined(header, body)).getAttribute('position').array);
}

const kNumber = 'u?char|u?short|u?int|float|double|u?int8|u?int16|u?int32|float32|float64';
const kFormat = /^format (ascii|binary_little_endian|binary_big_endian) 1\.0$/;
const kElement = /^element (\S+) (\d{1,15})$/;
const kProperty = new RegExp(`^property (${kNumber}|list (?:${kNumber}) (?:${kNumber})) (\\S+)$`);

/** A header that the loader takes, and how many points it promises. @param bytes of the body */
function plainHeader(lines: readonly string[], bytes: number, file: string): { header: string; count: number } {
  const plain = ['ply'];
  const types = new Map<string, string>();
  let count: number | undefined;
  for (const line of lines) {
    const element = kElement.exec(line);
    if (element !== null && count !== undefined) break;
    if (element?.[1] === 'vertex') count = Number(element[2]);
    // Each takes a byte at least: a short file must not keep the page busy for long.
    if (element !== null && Number(element[2]) > bytes) {
      throw new ScanError(file, `its header promises ${element[2]} of ${element[1]}, and only ${bytes} bytes follow`, kExportAgain);
    }
    const property = kProperty.exec(line);
    if (property === null && element === null && !kFormat.test(line)) {
      throw new ScanError(file, `its header has the line '${line.slice(0, 60)}'`, kSaveAgain);
    }
    const axis = property !== null && count !== undefined && /^[xyz]$/i.test(property[2]!) ? property[2]!.toLowerCase() : undefined;
    if (axis !== undefined) types.set(axis, property![1]!);
    plain.push(property === null ? line : `property ${property[1]} ${axis ?? `other${plain.length}`}`);
  }
  if (count === undefined) throw new ScanError(file, 'it has no element vertex', kSaveAgain);
  // The loader reads all three as the type of x.
  if (types.size !== 3 || new Set(types.values()).size !== 1 || types.get('x')!.startsWith('list')) {
    throw new ScanError(file, 'its element vertex has no x, y and z of one type', kSaveAgain);
  }
  return { header: `${plain.join('\n')}\nend_header\n`, count };
}

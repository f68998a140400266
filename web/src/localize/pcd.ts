import { PCDLoader } from 'three/examples/jsm/loaders/PCDLoader.js';
import {
  checkPointCount, joined, kExportAgain, loadedPoints, numbersText, ScanError, type ScanLimits, type ScanPoints,
} from './scan_points.js';

const kMaxHeaderBytes = 65_536;
const kSaveAgain = 'Save the scan as PCD version 0.7, for example with PCL, Open3D or CloudCompare';

interface Field {
  name: string;
  size: number;
  type: string;
  count: number;
}

interface Header {
  fields: Field[];
  points: number;
  encoding: string;
  /** Where the points begin [bytes]. */
  body: number;
}

/**
 * Reads the coordinates of a PCD file with three.js: ascii, binary or binary_compressed.
 *
 * The loader trusts the header. So the header is checked against the bytes first, and the loader gets a plain one in
 * which every field but x, y and z is padding.
 * @throws ScanError when the file is not a PCD file, is incomplete, or has more points than allowed.
 * @note VIEWPOINT is not applied: the server does not apply it either.
 */
export function decodePcd(bytes: Uint8Array<ArrayBuffer>, file: string, limits: ScanLimits): ScanPoints {
  const header = parseHeader(bytes, file);
  checkPointCount(file, header.points, limits);
  let body = bytes.subarray(header.body);
  if (header.encoding === 'ascii') body = asciiRows(body, header, file);
  else checkSize(body, header, file);
  const plain = joined(headerText(header), body);
  return loadedPoints(file, header.points, () => new PCDLoader().parse(plain).geometry.getAttribute('position').array);
}

function parseHeader(bytes: Uint8Array, file: string): Header {
  const text = new TextDecoder('latin1').decode(bytes.subarray(0, kMaxHeaderBytes));
  const data = /^DATA[ \t]+(\S+)[ \t\r]*\n/m.exec(text);
  if (data === null) throw new ScanError(file, 'its header has no DATA line', kExportAgain);
  const encoding = data[1]!;
  if (!['ascii', 'binary', 'binary_compressed'].includes(encoding)) {
    throw new ScanError(file, `DATA ${encoding.slice(0, 40)} is not ascii, binary or binary_compressed`, kSaveAgain);
  }
  const lines = new Map<string, string[]>();
  for (const line of text.slice(0, data.index).split('\n')) {
    const [key = '', ...values] = line.trim().split(/\s+/);
    lines.set(key === 'COLUMNS' ? 'FIELDS' : key, values);
  }
  return { fields: fieldsOf(lines, file), points: pointsOf(lines, file), encoding, body: data.index + data[0].length };
}

function fieldsOf(lines: Map<string, string[]>, file: string): Field[] {
  const names = lines.get('FIELDS') ?? [];
  const { SIZE: sizes = [], TYPE: types = [], COUNT: counts = names.map(() => '1') } = Object.fromEntries(lines);
  const fields = names.map((name, i): Field => ({
    name: name.toLowerCase(), size: Number(sizes[i]), type: types[i]?.toUpperCase() ?? '', count: Number(counts[i]),
  }));
  for (const { name, size, type, count } of fields) {
    const isKnown = /^(F[48]|[IU][1248])$/.test(type + size) && Number.isInteger(count) && count >= 0;
    if (!isKnown) throw new ScanError(file, `the field ${name} has no usable SIZE, TYPE and COUNT (${size} ${type} ${count})`, kSaveAgain);
  }
  for (const axis of ['x', 'y', 'z']) {
    const found = fields.filter(({ name }) => name === axis);
    // Integers of 8 bytes are what the loader cannot read.
    if (found.length !== 1 || found[0]!.count !== 1 || /^[IU]8$/.test(found[0]!.type + found[0]!.size)) {
      throw new ScanError(file, `FIELDS ${names.join(' ').slice(0, 200)} has not exactly one usable ${axis}`, kSaveAgain);
    }
  }
  return fields;
}

function pointsOf(lines: Map<string, string[]>, file: string): number {
  const product = (keys: string[]): number => keys.reduce((all, key) => all * Number(lines.get(key)?.[0] ?? 1), 1);
  const isThere = (key: string): boolean => lines.has(key);
  const counts = [['WIDTH', 'HEIGHT'], ['POINTS']].filter(([key]) => isThere(key!)).map(product);
  if (counts.length === 0 || counts.some((count) => !Number.isSafeInteger(count) || count < 0 || count !== counts[0])) {
    throw new ScanError(file, 'its header does not say how many points there are, or WIDTH, HEIGHT and POINTS disagree', kSaveAgain);
  }
  return counts[0]!;
}

function headerText({ fields, points, encoding }: Header): string {
  const line = (key: string, of: (field: Field) => string | number): string => `${key} ${fields.map(of).join(' ')}\n`;
  return 'VERSION 0.7\n' + line('FIELDS', ({ name }) => (/^[xyz]$/.test(name) ? name : '_')) + line('SIZE', ({ size }) => size) +
    line('TYPE', ({ type }) => type) + line('COUNT', ({ count }) => count) + `WIDTH ${points}\nHEIGHT 1\nPOINTS ${points}\nDATA ${encoding}\n`;
}

function checkSize(body: Uint8Array, { fields, points, encoding }: Header, file: string): void {
  const needed = points * fields.reduce((sum, { size, count }) => sum + size * count, 0);
  if (encoding === 'binary') {
    if (body.length < needed) throw new ScanError(file, `it ends after ${body.length} of ${needed} bytes of points`, kExportAgain);
    return;
  }
  const sizes = new DataView(body.buffer, body.byteOffset, Math.min(8, body.length));
  const packed = body.length < 8 ? Infinity : sizes.getUint32(0, true);
  if (body.length < 8 + packed) throw new ScanError(file, `it ends after ${body.length} bytes of compressed points`, kExportAgain);
  const unpacked = sizes.getUint32(4, true);
  if (unpacked !== needed) {
    throw new ScanError(file, `its compressed points have ${unpacked} bytes, and its header promises ${needed}`, kExportAgain);
  }
}

/** The lines with points, each of as many numbers as the header says: the loader counts blank and short lines as points. */
function asciiRows(body: Uint8Array, { fields, points }: Header, file: string): Uint8Array<ArrayBuffer> {
  const numbers = fields.reduce((sum, { count }) => sum + count, 0);
  const rows = numbersText(file, body).split('\n').map((row) => row.trim()).filter((row) => row !== '').slice(0, points);
  const wrong = rows.findIndex((row) => row.split(/\s+/).length !== numbers);
  if (wrong >= 0) throw new ScanError(file, `point ${wrong + 1} has not ${numbers} numbers`, kExportAgain);
  return new TextEncoder().encode(rows.join('\n'));
}

import { unpackLzf } from './lzf.js';
import { coordinateFields, kNumberKinds, type Field } from './number_kinds.js';
import { checkPointCount, PointCollector, ScanError, type ScanLimits, type ScanPoints } from './scan_points.js';

const kMaxHeaderBytes = 65_536;
const kMaxFieldCount = 65_536;
const kMaxFields = 256;

interface Header {
  fields: Field[];
  points: number;
  encoding: string;
  body: number;
}

/**
 * Reads the coordinates of a PCD file: ascii, binary or binary_compressed.
 *
 * @throws ScanError when it is none, breaks off, or holds more points than allowed.
 * @note Its VIEWPOINT is not applied: the server does not either.
 */
export function decodePcd(bytes: Uint8Array<ArrayBuffer>, file: string, limits: ScanLimits): ScanPoints {
  const header = parseHeader(bytes, file);
  checkPointCount(file, header.points, limits);
  const axes = coordinateFields(header.fields);
  if (axes === null) {
    const names = header.fields.map((field) => field.name).join(' ');
    throw new ScanError(file, `FIELDS ${names}`, 'one x, one y and one z');
  }
  const body = bytes.subarray(header.body);
  if (header.encoding === 'ascii') return readAscii(body, header, axes, file);
  if (header.encoding === 'binary') return readBinary(body, header, axes, file);
  return readCompressed(body, header, axes, file);
}

function parseHeader(bytes: Uint8Array, file: string): Header {
  const text = new TextDecoder('latin1').decode(bytes.subarray(0, kMaxHeaderBytes));
  const data = /^DATA[ \t]+(\S+)[ \t\r]*\n/m.exec(text);
  if (data === null) throw new ScanError(file, 'no DATA line', 'the header of a PCD file');
  const encoding = data[1]!;
  if (!['ascii', 'binary', 'binary_compressed'].includes(encoding)) {
    throw new ScanError(file, `DATA ${encoding.slice(0, 40)}`, 'ascii, binary or binary_compressed');
  }
  const lines = new Map<string, string[]>();
  for (const line of text.slice(0, data.index).split('\n')) {
    const [key = '', ...values] = line.trim().split(/\s+/);
    if (!key.startsWith('#')) lines.set(key === 'COLUMNS' ? 'FIELDS' : key, values);
  }
  return {
    fields: parseFields(lines, file),
    points: parsePoints(lines, file),
    encoding,
    body: data.index + data[0].length,
  };
}

function parseFields(lines: Map<string, string[]>, file: string): Field[] {
  const names = lines.get('FIELDS') ?? [];
  const sizes = lines.get('SIZE') ?? [];
  const types = lines.get('TYPE') ?? [];
  const counts = lines.get('COUNT') ?? names.map(() => '1');
  if (names.length > kMaxFields || [sizes, types, counts].some((list) => list.length !== names.length)) {
    const found = `${names.length} FIELDS, ${sizes.length} SIZE, ${types.length} TYPE, ${counts.length} COUNT`;
    throw new ScanError(file, found, `as many of each, at most ${kMaxFields}`);
  }
  return names.map((name, i) => {
    const key = `${types[i]!.toLowerCase()}${sizes[i]!}`;
    if (!Object.hasOwn(kNumberKinds, key)) {
      throw new ScanError(file, `TYPE ${types[i]} SIZE ${sizes[i]}`, 'I or U with 1 2 4 8, or F with 4 8');
    }
    const count = /^\d+$/.test(counts[i]!) ? Number(counts[i]) : Number.NaN;
    if (!(count <= kMaxFieldCount)) throw new ScanError(file, `COUNT ${counts[i]}`, '0 to 65536');
    return { name, kind: kNumberKinds[key as keyof typeof kNumberKinds], count };
  });
}

function parsePoints(lines: Map<string, string[]>, file: string): number {
  const whole = (key: string): number | undefined => {
    const text = lines.get(key)?.[0];
    if (text !== undefined && !/^\d{1,15}$/.test(text)) throw new ScanError(file, `${key} ${text}`, 'a whole number');
    return text === undefined ? undefined : Number(text);
  };
  const width = whole('WIDTH');
  const stated = whole('POINTS');
  const points = width === undefined ? stated : width * (whole('HEIGHT') ?? 1);
  if (points === undefined) throw new ScanError(file, 'no WIDTH and no POINTS', 'one of them');
  if (stated !== undefined && stated !== points) {
    throw new ScanError(file, `POINTS ${stated}`, `WIDTH * HEIGHT = ${points}`);
  }
  return points;
}

const fieldBytes = (field: Field): number => field.count * field.kind.bytes;

/** Where each field begins: within one point, or, when `rows` are stored column by column, within all of them. */
function offsetsOf(fields: readonly Field[], rows: number): number[] {
  let next = 0;
  return fields.map((field) => (next += rows * fieldBytes(field)) - rows * fieldBytes(field));
}

function checkBytes(found: number, needed: number, points: number, file: string): void {
  if (found < needed) throw new ScanError(file, `${found} bytes of points`, `${needed} for ${points} points`);
}

function readBinary(body: Uint8Array, header: Header, axes: readonly number[], file: string): ScanPoints {
  const stride = header.fields.reduce((sum, field) => sum + fieldBytes(field), 0);
  checkBytes(body.length, stride * header.points, header.points, file);
  const view = new DataView(body.buffer, body.byteOffset, body.byteLength);
  const offsets = offsetsOf(header.fields, 1);
  const points = new PointCollector(header.points);
  const read = (axis: number, row: number): number =>
    header.fields[axis]!.kind.read(view, row * stride + offsets[axis]!, true);
  for (let row = 0; row < header.points; ++row) points.add(read(axes[0]!, row), read(axes[1]!, row), read(axes[2]!, row));
  return points.finish();
}

function readCompressed(body: Uint8Array, header: Header, axes: readonly number[], file: string): ScanPoints {
  checkBytes(body.length, 8, header.points, file);
  const sizes = new DataView(body.buffer, body.byteOffset, 8);
  const packed = sizes.getUint32(0, true);
  const size = sizes.getUint32(4, true);
  checkBytes(body.length - 8, packed, header.points, file);
  // PCL leaves columns named "_" out of what it packs; others pack them too.
  const whole = header.points * header.fields.reduce((sum, field) => sum + fieldBytes(field), 0);
  const named = header.fields.map((field) => (field.name === '_' ? { ...field, count: 0 } : field));
  const least = header.points * named.reduce((sum, field) => sum + fieldBytes(field), 0);
  if (size !== whole && size !== least) throw new ScanError(file, `${size} bytes unpacked`, `${least} or ${whole}`);
  const columns = unpackLzf(body.subarray(8, 8 + packed), size);
  if (columns === null) throw new ScanError(file, 'compressed points that break off', `LZF of ${size} bytes`);
  const view = new DataView(columns.buffer);
  const offsets = offsetsOf(size === whole ? header.fields : named, header.points);
  const points = new PointCollector(header.points);
  const read = (axis: number, row: number): number => {
    const { kind } = header.fields[axis]!;
    return kind.read(view, offsets[axis]! + row * kind.bytes, true);
  };
  for (let row = 0; row < header.points; ++row) points.add(read(axes[0]!, row), read(axes[1]!, row), read(axes[2]!, row));
  return points.finish();
}

function readAscii(body: Uint8Array, header: Header, axes: readonly number[], file: string): ScanPoints {
  // Each number takes a digit and a blank, so a short file cannot ask for much memory.
  const numbers = header.fields.reduce((sum, field) => sum + field.count, 0);
  checkBytes(body.length + 1, 2 * numbers * header.points, header.points, file);
  const offsets = header.fields.map((_, i) => header.fields.slice(0, i).reduce((sum, field) => sum + field.count, 0));
  const points = new PointCollector(header.points);
  let read = 0;
  for (const line of new TextDecoder('latin1').decode(body).split('\n')) {
    const words = line.trim().split(/\s+/);
    if (words[0] === '' || read === header.points) continue;
    if (words.length !== numbers) throw new ScanError(file, `${words.length} numbers in a line`, `${numbers}`);
    const [x, y, z] = axes.map((axis) => parseNumber(words[offsets[axis]!]!, file));
    points.add(x!, y!, z!);
    ++read;
  }
  if (read !== header.points) throw new ScanError(file, `${read} lines of points`, `${header.points}`);
  return points.finish();
}

function parseNumber(text: string, file: string): number {
  if (/^[+-]?(nan|inf(inity)?)$/i.test(text)) return Number.NaN;
  const value = Number(text);
  if (Number.isNaN(value)) throw new ScanError(file, `'${text.slice(0, 40)}'`, 'a number');
  return value;
}

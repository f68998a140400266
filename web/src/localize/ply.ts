import { coordinateFields, kNumberKinds, type NumberKind } from './number_kinds.js';
import { checkPointCount, PointCollector, ScanError, type ScanLimits, type ScanPoints } from './scan_points.js';

const kMaxHeaderBytes = 65_536;

const kKindOfType: Record<string, NumberKind> = {
  char: kNumberKinds.i1, int8: kNumberKinds.i1, uchar: kNumberKinds.u1, uint8: kNumberKinds.u1,
  short: kNumberKinds.i2, int16: kNumberKinds.i2, ushort: kNumberKinds.u2, uint16: kNumberKinds.u2,
  int: kNumberKinds.i4, int32: kNumberKinds.i4, uint: kNumberKinds.u4, uint32: kNumberKinds.u4,
  float: kNumberKinds.f4, float32: kNumberKinds.f4, double: kNumberKinds.f8, float64: kNumberKinds.f8,
};

interface Property {
  name: string;
  kind: NumberKind;
  /** Kind of the number that says how many follow, of lists. */
  length?: NumberKind;
}

interface Element {
  name: string;
  count: number;
  properties: Property[];
}

interface Header {
  encoding: 'ascii' | 'little' | 'big';
  elements: Element[];
  body: number;
}

/** The body's numbers one after the other, in any encoding; NaN for ever once it has ended. */
interface NumberStream {
  next(kind: NumberKind): number;
  readonly ended: boolean;
}

/**
 * Reads the coordinates of a PLY file's element `vertex`: ascii, or binary of either byte order.
 *
 * @throws ScanError when it is none, breaks off, or holds more points than allowed.
 */
export function decodePly(bytes: Uint8Array<ArrayBuffer>, file: string, limits: ScanLimits): ScanPoints {
  const header = parseHeader(bytes, file);
  const body = bytes.subarray(header.body);
  const stream = header.encoding === 'ascii' ? textStream(body) : byteStream(body, header.encoding === 'little');
  for (const element of header.elements) {
    // Each instance takes a byte at least, so that a short file cannot keep us busy for long.
    const needed = element.properties.length === 0 ? 0 : element.count;
    if (needed > body.length) throw new ScanError(file, `${body.length} bytes`, `${element.count} of ${element.name}`);
    if (element.name === 'vertex') return readVertices(stream, element, file, limits);
    for (let i = 0; i < element.count && !stream.ended; ++i) readInstance(stream, element, file);
  }
  throw new ScanError(file, 'no element vertex', 'the points of a PLY file');
}

function readVertices(stream: NumberStream, element: Element, file: string, limits: ScanLimits): ScanPoints {
  checkPointCount(file, element.count, limits);
  const axes = coordinateFields(element.properties.map((each) => ({ ...each, count: each.length ? 0 : 1 })));
  if (axes === null) {
    const names = element.properties.map((property) => property.name).join(' ');
    throw new ScanError(file, `vertex with ${names}`, 'one x, one y and one z');
  }
  const points = new PointCollector(element.count);
  for (let i = 0; i < element.count; ++i) {
    const values = readInstance(stream, element, file);
    if (stream.ended) throw new ScanError(file, `${i} points`, `${element.count}`);
    points.add(values[axes[0]]!, values[axes[1]]!, values[axes[2]]!);
  }
  return points.finish();
}

/** @returns a value for each property; of lists their length. */
function readInstance(stream: NumberStream, element: Element, file: string): number[] {
  return element.properties.map((property) => {
    const value = stream.next(property.length ?? property.kind);
    if (property.length === undefined) return value;
    if (value < 0 || (!Number.isInteger(value) && !stream.ended)) {
      throw new ScanError(file, `a list of ${value} numbers`, 'a whole length');
    }
    for (let i = 0; i < value && !stream.ended; ++i) stream.next(property.kind);
    return value;
  });
}

function parseHeader(bytes: Uint8Array, file: string): Header {
  const text = new TextDecoder('latin1').decode(bytes.subarray(0, kMaxHeaderBytes));
  const end = /^end_header[ \t\r]*\n/m.exec(text);
  if (!/^ply[ \t\r]*\n/.test(text) || end === null) {
    throw new ScanError(file, 'no header from ply to end_header', 'a PLY file');
  }
  const header: Header = { encoding: 'ascii', elements: [], body: end.index + end[0].length };
  for (const line of text.slice(0, end.index).split('\n').slice(1)) {
    takeLine(line.trim().split(/\s+/), header, file);
  }
  return header;
}

function takeLine(words: string[], header: Header, file: string): void {
  const last = header.elements.at(-1);
  if (words[0] === '' || words[0] === 'comment' || words[0] === 'obj_info') return;
  if (words[0] === 'format') {
    header.encoding = parseEncoding(words[1] ?? '', file);
  } else if (words[0] === 'element' && /^\d{1,15}$/.test(words[2] ?? '')) {
    header.elements.push({ name: words[1]!, count: Number(words[2]), properties: [] });
  } else if (words[0] === 'property' && last !== undefined) {
    last.properties.push(parseProperty(words, file));
  } else {
    throw new ScanError(file, `header line '${words.join(' ').slice(0, 60)}'`, 'a PLY header line in its place');
  }
}

function parseEncoding(text: string, file: string): Header['encoding'] {
  const encodings: Record<string, Header['encoding']> = {
    ascii: 'ascii', binary_little_endian: 'little', binary_big_endian: 'big',
  };
  const encoding = Object.hasOwn(encodings, text) ? encodings[text] : undefined;
  if (encoding === undefined) {
    throw new ScanError(file, `format ${text.slice(0, 40)}`, 'ascii, binary_little_endian or binary_big_endian');
  }
  return encoding;
}

function parseProperty(words: string[], file: string): Property {
  const kindOf = (type: string | undefined): NumberKind => {
    const kind = type !== undefined && Object.hasOwn(kKindOfType, type) ? kKindOfType[type] : undefined;
    if (kind === undefined) throw new ScanError(file, `property type ${String(type).slice(0, 40)}`, 'a PLY number type');
    return kind;
  };
  if (words[1] !== 'list') return { name: words[2] ?? '', kind: kindOf(words[1]) };
  return { name: words[4] ?? '', kind: kindOf(words[3]), length: kindOf(words[2]) };
}

function byteStream(body: Uint8Array, littleEndian: boolean): NumberStream {
  const view = new DataView(body.buffer, body.byteOffset, body.byteLength);
  let at = 0;
  const stream = {
    ended: false,
    next(kind: NumberKind): number {
      stream.ended ||= at + kind.bytes > view.byteLength;
      if (stream.ended) return Number.NaN;
      at += kind.bytes;
      return kind.read(view, at - kind.bytes, littleEndian);
    },
  };
  return stream;
}

function textStream(body: Uint8Array): NumberStream {
  const words = new TextDecoder('latin1').decode(body).matchAll(/\S+/g);
  const stream = {
    ended: false,
    next(): number {
      const word = stream.ended ? undefined : words.next().value?.[0];
      stream.ended ||= word === undefined;
      return Number(word);
    },
  };
  return stream;
}

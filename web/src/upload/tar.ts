// A tar of files on the person's disk, made without reading them: headers in memory, the files by reference.
// The same files give the same bytes, so that an interrupted upload can be resumed.

export interface TarEntry {
  /** Relative, with `/` between its parts. */
  path: string;
  file: Blob & { lastModified?: number };
}

const kBlock = 512;

/**
 * The archive as one Blob. A slice of it is read from the files only when it is needed.
 *
 * POSIX ustar, with a pax header for a path that is longer than 100 bytes or not ASCII, and for a file of 8 GiB or more.
 */
export function tarOf(entries: readonly TarEntry[]): Blob {
  const pieces: BlobPart[] = [];
  const sorted = [...entries].sort((a, b) => (a.path < b.path ? -1 : a.path > b.path ? 1 : 0));
  for (const { path, file } of sorted) {
    const time_s = Math.floor((file.lastModified ?? 0) / 1000);
    const records = paxRecords(path, file.size);
    if (records.length > 0) pieces.push(header('pax', records.length, time_s, 'x'), records, padding(records.length));
    pieces.push(header(path, file.size, time_s, '0'), file, padding(file.size));
  }
  pieces.push(new Uint8Array(2 * kBlock));
  return new Blob(pieces);
}

function padding(size: number): Uint8Array<ArrayBuffer> {
  return new Uint8Array((kBlock - (size % kBlock)) % kBlock);
}

function header(path: string, size: number, time_s: number, type: '0' | 'x'): Uint8Array<ArrayBuffer> {
  const block = new Uint8Array(kBlock);
  const put = (text: string, at: number, most: number): void => {
    block.set(new TextEncoder().encode(text).subarray(0, most), at);
  };
  put(path, 0, 100);
  put('0000644\0', 100, 8);
  put('0000000\0', 108, 8);
  put('0000000\0', 116, 8);
  put(octal(size < 8 ** 11 ? size : 0), 124, 12);
  put(octal(time_s), 136, 12);
  put(`        ${type}`, 148, 9);
  put('ustar\u000000', 257, 8);
  const sum = block.reduce((total, byte) => total + byte, 0);
  put(`${sum.toString(8).padStart(6, '0')}\0 `, 148, 8);
  return block;
}

function octal(value: number): string {
  return `${value.toString(8).padStart(11, '0')}\0`;
}

function paxRecords(path: string, size: number): Uint8Array<ArrayBuffer> {
  const encoded = new TextEncoder().encode(path);
  const plain = encoded.length <= 100 && encoded.every((byte) => byte < 128);
  const records = [...(plain ? [] : [paxRecord('path', path)]), ...(size < 8 ** 11 ? [] : [paxRecord('size', String(size))])];
  return new TextEncoder().encode(records.join(''));
}

/** "LENGTH key=value\n", where LENGTH counts its own digits. */
function paxRecord(key: string, value: string): string {
  const bare = new TextEncoder().encode(` ${key}=${value}\n`).length;
  let length = bare + String(bare).length;
  if (String(length).length !== String(bare).length) length = bare + String(length).length;
  return `${length} ${key}=${value}\n`;
}

/**
 * Names of the first entries of a plain tar, in order; empty if it is not a tar.
 *
 * @param most  stops after this many.
 */
export async function tarNames(tar: Blob, most: number): Promise<string[]> {
  const names: string[] = [];
  let at = 0;
  let longName: string | undefined;
  while (names.length < most && at + kBlock <= tar.size) {
    const block = new Uint8Array(await tar.slice(at, at + kBlock).arrayBuffer());
    if (text(block, 257, 5) !== 'ustar') return names;
    const size = Number.parseInt(text(block, 124, 12), 8) || 0;
    const type = text(block, 156, 1);
    if (type === 'x' || type === 'L') {
      longName = longNameOf(type, new TextDecoder().decode(await tar.slice(at + kBlock, at + kBlock + size).arrayBuffer()));
    } else {
      const prefix = text(block, 345, 155);
      if (type !== 'g') names.push(longName ?? (prefix === '' ? '' : `${prefix}/`) + text(block, 0, 100));
      longName = undefined;
    }
    at += kBlock + Math.ceil(size / kBlock) * kBlock;
  }
  return names;
}

function longNameOf(type: string, content: string): string | undefined {
  return type === 'L' ? content.replace(/\0+$/, '') : /^\d+ path=(.*)$/m.exec(content)?.[1];
}

function text(block: Uint8Array, at: number, length: number): string {
  const field = block.subarray(at, at + length);
  const end = field.indexOf(0);
  return new TextDecoder().decode(end < 0 ? field : field.subarray(0, end));
}

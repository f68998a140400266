import { tarNames } from './tar.js';

/** What can be uploaded: a map package, a map of points from elsewhere, a drive. */
export type Kind = 'package' | 'pcd' | 'ply' | 'las' | 'drive';

/** The content types of maps from elsewhere. */
export const kPointTypes = { pcd: 'application/vnd.pcd', ply: 'application/ply', las: 'application/vnd.las' } as const;

/** Where the server keeps what is being uploaded of a kind. */
export function collectionOf(kind: Kind): 'drives' | 'uploads' {
  return kind === 'drive' ? 'drives' : 'uploads';
}

/** What is uploaded with a content type. */
export function kindOfType(contentType: string): Kind {
  return (Object.keys(kPointTypes) as (keyof typeof kPointTypes)[]).find((kind) => kPointTypes[kind] === contentType) ?? 'package';
}

export type Packing = 'tar' | 'gzip' | 'zstd';

export type Look =
  /** `sure`: seen in the content; otherwise the person is asked. */
  | { kind: Kind; sure: boolean; packing?: Packing; why?: string }
  /** Nothing that the server would take, in words. */
  | { refused: string };

export const kKindWords: Record<Kind, string> = {
  package: 'Map package',
  pcd: 'Map from elsewhere (PCD)',
  ply: 'Map from elsewhere (PLY)',
  las: 'Map from elsewhere (LAS)',
  drive: 'Drive',
};

const kNamesRead = 400;
const kUnpackedRead = 1 << 20;

/** Looks into a file as far as is needed to tell what it is. */
export async function lookAt(file: File): Promise<Look> {
  if (file.size === 0) return { refused: `“${file.name}” is empty.` };
  const head = new Uint8Array(await file.slice(0, 512).arrayBuffer());
  const starts = (...bytes: number[]): boolean => bytes.every((byte, at) => head[at] === byte);
  const text = new TextDecoder('latin1').decode(head);
  if (/^ply\r?\n/.test(text)) return { kind: 'ply', sure: true };
  if (/^(#.*\r?\n)*\s*VERSION\s+\.?\d/.test(text)) return { kind: 'pcd', sure: true };
  if (text.startsWith('LASF')) return isLaz(head) ? { refused: `“${file.name}”: ${kLaz}.` } : { kind: 'las', sure: true };
  if (text.slice(257, 262) === 'ustar') return lookAtTar(await tarNames(file, kNamesRead), 'tar');
  if (starts(0x1f, 0x8b)) return lookAtTar(await tarNames(await unpackedHead(file), kNamesRead), 'gzip');
  if (starts(0x28, 0xb5, 0x2f, 0xfd)) {
    const kind = /drive|kitti|mulran|seq/i.test(file.name) ? 'drive' : 'package';
    return { kind, sure: false, packing: 'zstd', why: 'Packed by zstd: the browser cannot look inside.' };
  }
  return { refused: foreignWords(file.name, starts) };
}

/** @param names of a tar's entries, or of a folder's files. */
function lookAtTar(names: readonly string[], packing: Packing): Look {
  if (names.length === 0) return { refused: `This file is packed (${packing}), but what is in it is no tar.` };
  const isManifest = names.some((name) => /^(\.\/)?([^/]+\/)?manifest\.json$/.test(name));
  const hasTiles = names.some((name) => /(^|\/)tiles\//.test(name));
  if (isManifest || hasTiles) return { kind: 'package', sure: true, packing };
  return { kind: 'drive', sure: names.some((name) => kScan.test(name) || kRecording.test(name)), packing };
}

/** A drive in one file. */
export const kRecording = /\.(mcap|db3)(\.zstd)?$|\.rawlog$/i;
const kScan = /\.(bin|pcd|ply)$/i;

/** A dropped folder: a package, or a drive if there is any scan in it. */
export function lookAtFolder(name: string, paths: readonly string[]): Look {
  if (paths.length === 0) return { refused: `The folder “${name}” is empty.` };
  const look = lookAtTar(paths, 'tar');
  if ('kind' in look && look.kind === 'drive' && !look.sure) {
    return { refused: `In the folder “${name}” there is neither a map package (manifest.json) nor a scan (.bin, .pcd, .ply, .mcap, .db3, .rawlog).` };
  }
  return look;
}

const kLaz = 'packed as LAZ, which is not taken: unpack it to LAS';

/** LASzip marks what it packed in the number of the point format, byte 104 of the header. */
function isLaz(head: Uint8Array): boolean {
  return ((head[104] ?? 0) & 0x80) !== 0;
}

const kForeign: [RegExp, string][] = [
  [/\.zip$/i, 'zip archives are not taken: drop the unpacked folder, or pack it as a tar'],
  [/\.(7z|rar)$/i, 'such archives are not taken: drop the unpacked folder, or pack it as a tar'],
  [/\.laz$/i, kLaz],
  [/\.las$/i, 'no LAS: it does not begin with LASF'],
  [/\.(e57|pts|xyz|csv|obj)$/i, 'this format is not taken: convert the points to LAS, PCD or PLY'],
  [/\.bag$/i, 'ROS 1 bags are not taken: convert it to MCAP or rosbag2, and drop its folder'],
  [/\.bin$/i, 'this may be a single scan: a drive is a folder of scans, drop that; to localize a scan, go to the map’s localization'],
];

function foreignWords(name: string, starts: (...bytes: number[]) => boolean): string {
  const known = kForeign.find(([pattern]) => pattern.test(name))?.[1]
    ?? (starts(0x50, 0x4b, 3, 4) ? kForeign[0]?.[1] : undefined)
    ?? 'found neither a tar (plain, gzip, zstd) nor LAS, PCD or PLY';
  return `“${name}”: ${known}.`;
}

/** The first bytes of what a gzip file holds; empty where the browser cannot unpack. */
async function unpackedHead(file: File): Promise<Blob> {
  if (typeof DecompressionStream === 'undefined') return new Blob([]);
  const reader = file.stream().pipeThrough(new DecompressionStream('gzip')).getReader();
  const pieces: BlobPart[] = [];
  let size = 0;
  try {
    while (size < kUnpackedRead) {
      const { done, value } = await reader.read();
      if (done) break;
      pieces.push(value as Uint8Array<ArrayBuffer>);
      size += value.length;
    }
  } catch {
    // Cut off or damaged: the server says so in its own words.
  } finally {
    await reader.cancel().catch(() => undefined);
  }
  return new Blob(pieces);
}

import { tarNames } from './tar.js';

/** What can be uploaded: a map package, a point cloud map of another program, a drive. */
export type Kind = 'package' | 'pcd' | 'ply' | 'las' | 'drive';

/** The content types of point cloud maps. */
export const kPointTypes = { pcd: 'application/vnd.pcd', ply: 'application/ply', las: 'application/vnd.las' } as const;

/** The server's collection for uploads of a kind. */
export function collectionOf(kind: Kind): 'drives' | 'uploads' {
  return kind === 'drive' ? 'drives' : 'uploads';
}

/** The kind that is uploaded with a content type. */
export function kindOfType(contentType: string): Kind {
  return (Object.keys(kPointTypes) as (keyof typeof kPointTypes)[]).find((kind) => kPointTypes[kind] === contentType) ?? 'package';
}

export type Packing = 'tar' | 'gzip' | 'zstd';

export type Look =
  /** `sure`: known from the content; otherwise the person is asked. */
  | { kind: Kind; sure: boolean; packing?: Packing; why?: string }
  /** Why the server would refuse it, with what to do. */
  | { refused: string };

export const kKindWords: Record<Kind, string> = {
  package: 'Map package',
  pcd: 'Point cloud map (PCD)',
  ply: 'Point cloud map (PLY)',
  las: 'Point cloud map (LAS)',
  drive: 'Drive',
};

const kNamesRead = 400;
const kUnpackedRead = 1 << 20;

/** Reads the start of a file to find out its kind. */
export async function lookAt(file: File): Promise<Look> {
  if (file.size === 0) return { refused: `“${file.name}” is empty. Choose another file.` };
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
    return { kind, sure: false, packing: 'zstd', why: 'The file is packed with zstd, which the browser cannot unpack.' };
  }
  return { refused: foreignWords(file.name, starts) };
}

/** @param names of a tar's entries, or of a folder's files. */
function lookAtTar(names: readonly string[], packing: Packing): Look {
  if (names.length === 0) return { refused: `This ${packing} file does not contain a tar. Pack the folder as a tar, or drop the folder itself.` };
  const isManifest = names.some((name) => /^(\.\/)?([^/]+\/)?manifest\.json$/.test(name));
  const hasTiles = names.some((name) => /(^|\/)tiles\//.test(name));
  if (isManifest || hasTiles) return { kind: 'package', sure: true, packing };
  return { kind: 'drive', sure: names.some((name) => kScan.test(name) || kRecording.test(name)), packing };
}

/** Names of drives in one file. */
export const kRecording = /\.(mcap|db3)(\.zstd)?$|\.(bag|pcap|pcapng|rawlog)$/i;
const kScan = /\.(bin|pcd|ply)$/i;

/** A dropped folder: a package, or a drive if it contains a scan. */
export function lookAtFolder(name: string, paths: readonly string[]): Look {
  if (paths.length === 0) return { refused: `The folder “${name}” is empty. Choose another folder.` };
  const look = lookAtTar(paths, 'tar');
  if ('kind' in look && look.kind === 'drive' && !look.sure) {
    return { refused: `The folder “${name}” has neither a map package (manifest.json) nor scans (.bin, .pcd, .ply, .mcap, .db3, .bag, .pcap, .pcapng, .rawlog). Choose the folder that contains them.` };
  }
  return look;
}

const kLaz = 'LAZ is not supported: unpack it to LAS';

/** LASzip sets the highest bit of the point format, byte 104 of the header. */
function isLaz(head: Uint8Array): boolean {
  return ((head[104] ?? 0) & 0x80) !== 0;
}

const kForeign: [RegExp, string][] = [
  [/\.zip$/i, 'zip archives are not supported: drop the unpacked folder, or pack it as a tar'],
  [/\.(7z|rar)$/i, 'such archives are not supported: drop the unpacked folder, or pack it as a tar'],
  [/\.laz$/i, kLaz],
  [/\.las$/i, 'it is not a LAS file, since it does not start with LASF: export it again'],
  [/\.(e57|pts|xyz|csv|obj)$/i, 'this format is not supported: convert the points to LAS, PCD or PLY'],
  [/\.bin$/i, 'this may be a single scan: drop a folder of scans to upload a drive, or open “Localize” of a map to localize the scan'],
];

function foreignWords(name: string, starts: (...bytes: number[]) => boolean): string {
  const known = kForeign.find(([pattern]) => pattern.test(name))?.[1]
    ?? (starts(0x50, 0x4b, 3, 4) ? kForeign[0]?.[1] : undefined)
    ?? 'the format is unknown: choose a tar (plain, gzip or zstd), LAS, PCD or PLY';
  return `“${name}”: ${known}.`;
}

/** The first bytes of the content of a gzip file; empty if the browser cannot unpack it. */
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
    // Incomplete or damaged: the server reports that.
  } finally {
    await reader.cancel().catch(() => undefined);
  }
  return new Blob(pieces);
}

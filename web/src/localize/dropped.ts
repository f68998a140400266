import { byName } from './stamps.js';

/** The usable files of a drop: scans in the order of their names, and a times.txt. */
export interface Dropped {
  scans: File[];
  times: File | null;
  /** Names of files that are neither. */
  others: string[];
}

const kScanName = /\.(bin|pcd|ply)$/i;
/** A limit for a large folder that is dropped by mistake. */
const kMostFiles = 20_000;

/** Sorts chosen or dropped files by their use. */
export function sortDropped(files: readonly File[]): Dropped {
  const scans = files.filter((file) => kScanName.test(file.name)).sort(byName);
  const times = files.find((file) => /^(times|timestamps)\.txt$/i.test(file.name)) ?? null;
  const others = files.filter((file) => file !== times && !scans.includes(file)).map((file) => file.name);
  return { scans, times, others };
}

/** All files of a drop, those in folders too. */
export async function filesOf(transfer: DataTransfer): Promise<File[]> {
  // All items must be read before the first await, when the browser empties the drop.
  const entries = [...transfer.items].flatMap((item) => item.webkitGetAsEntry() ?? item.getAsFile() ?? []);
  const files: File[] = [];
  for (const entry of entries) {
    if (entry instanceof File) files.push(entry);
    else await collect(entry, files);
  }
  return files;
}

async function collect(entry: FileSystemEntry, files: File[]): Promise<void> {
  if (files.length >= kMostFiles) return;
  if (entry.isFile) {
    files.push(await new Promise<File>((resolve, reject) => (entry as FileSystemFileEntry).file(resolve, reject)));
    return;
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  for (;;) {
    // A reader returns a hundred at a time.
    const some = await new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return;
    for (const one of some) await collect(one, files);
  }
}

import { byName } from './stamps.js';

/** What of a drop can be used: scans in the order of their names, and the text of a times.txt among them. */
export interface Dropped {
  scans: File[];
  times: File | null;
  /** Names of files that are neither. */
  others: string[];
}

const kScanName = /\.(bin|pcd|ply)$/i;
/** Of a folder dropped by mistake, with everything below it. */
const kMostFiles = 20_000;

/** Takes apart what was chosen or dropped. */
export function sortDropped(files: readonly File[]): Dropped {
  const scans = files.filter((file) => kScanName.test(file.name)).sort(byName);
  const times = files.find((file) => /^(times|timestamps)\.txt$/i.test(file.name)) ?? null;
  const others = files.filter((file) => file !== times && !scans.includes(file)).map((file) => file.name);
  return { scans, times, others };
}

/** All files of a drop, those in folders too. */
export async function filesOf(transfer: DataTransfer): Promise<File[]> {
  // All of it must be taken before the first await: the browser empties the drop then.
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
    // A reader gives a hundred at a time.
    const some = await new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return;
    for (const one of some) await collect(one, files);
  }
}

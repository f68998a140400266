// What a person drops or chooses: one file, or a folder with all its files.

import { kRecording, lookAt, lookAtFolder, type Look } from './kind.js';
import { tarOf, type TarEntry } from './tar.js';
import type { Topic } from './topics.js';

export interface Chosen {
  /** Of the file or folder. */
  name: string;
  look: Look;
  /** The bytes to send: the file, or a tar of the folder. */
  content: Blob;
  /** Newest change of a file in it [ms since 1970]. */
  changedMs: number;
  files: number;
  /** Of a recording whose files have an index; else undefined. */
  topics?: Topic[] | undefined;
  /** What the folder's own `topics.txt` says of them. */
  ownWords?: string | undefined;
}

/** One file of an `<input type=file>`. A recording is a whole drive, and is packed like a folder. */
export async function chosenFile(file: File): Promise<Chosen> {
  if (kRecording.test(file.name) && file.size > 0) return chosenFolder(file.name, [{ path: file.name, file }]);
  return { name: file.name, look: await lookAt(file), content: file, changedMs: file.lastModified, files: 1 };
}

/** The files of an `<input type=file webkitdirectory>`, or of a dropped folder. @param files with paths below the folder */
async function chosenFolder(name: string, files: readonly TarEntry[]): Promise<Chosen> {
  const wanted = files.filter(({ path }) => !kClutter.test(path));
  const changedMs = wanted.reduce((newest, { file }) => Math.max(newest, file.lastModified ?? 0), 0);
  const look = lookAtFolder(name, wanted.map(({ path }) => path));
  if ('refused' in look) return { name, look, content: new Blob([]), changedMs, files: wanted.length };
  const recordings = wanted.filter(({ path }) => kIndexed.test(path));
  // Of several drives as one, lidars.json chooses.
  const asks = recordings.length > 0 && !wanted.some(({ path }) => /(^|\/)lidars\.json$/.test(path));
  const topics = asks ? await topicsOf(recordings.map(({ file }) => file)) : undefined;
  const own = wanted.find(({ path }) => /(^|\/)topics\.txt$/.test(path));
  const ownWords = topics === undefined ? undefined : await own?.file.slice(0, kMostWordsBytes).text();
  return { name, look, content: tarOf(wanted), changedMs, files: wanted.length, topics, ownWords };
}

const kMostWordsBytes = 1 << 16;

/** Undefined if a file has no index: then the server tells the topics after the upload, or what is broken. */
export async function topicsOf(recordings: readonly Blob[]): Promise<Topic[] | undefined> {
  try {
    const { readTopics } = await import('./recording.js');
    return await readTopics(recordings);
  } catch {
    return undefined;
  }
}

/** Recordings whose topics can be read here. */
const kIndexed = /\.(mcap|bag)$/i;

/** Files that file managers add. */
const kClutter = /(^|\/)(\.DS_Store|Thumbs\.db|desktop\.ini|\._[^/]*)$/;

/** @param list of an `<input webkitdirectory>`: paths begin with the folder's name. */
export function fromDirectoryInput(list: readonly File[]): Promise<Chosen> {
  const name = list[0]?.webkitRelativePath.split('/')[0] ?? 'folder';
  return chosenFolder(name, list.map((file) => ({ path: file.webkitRelativePath.slice(name.length + 1), file })));
}

/**
 * The dropped files and folders. Must be called within the drop event, since its list is empty afterwards.
 *
 * @return an empty list if there is no file.
 */
export async function fromDrop(transfer: DataTransfer): Promise<Chosen[]> {
  const items = [...transfer.items].filter(({ kind }) => kind === 'file');
  const dropped = items.map((item) => ({ entry: item.webkitGetAsEntry(), file: item.getAsFile() }));
  const all = await Promise.all(dropped.map(async ({ entry, file }) => {
    if (entry?.isDirectory === true) return chosenFolder(entry.name, await filesBelow(entry as FileSystemDirectoryEntry, ''));
    return file === null ? undefined : chosenFile(file);
  }));
  return all.filter((one) => one !== undefined);
}

function fileOf(entry: FileSystemFileEntry): Promise<File> {
  return new Promise((resolve, reject) => entry.file(resolve, reject));
}

async function filesBelow(folder: FileSystemDirectoryEntry, prefix: string): Promise<TarEntry[]> {
  const found: TarEntry[] = [];
  const reader = folder.createReader();
  for (;;) {
    // A folder is listed in pieces; the last piece is empty.
    const piece = await new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject));
    if (piece.length === 0) return found;
    for (const entry of piece) {
      const path = `${prefix}${entry.name}`;
      if (entry.isFile) found.push({ path, file: await fileOf(entry as FileSystemFileEntry) });
      else found.push(...await filesBelow(entry as FileSystemDirectoryEntry, `${path}/`));
    }
  }
}

// Uploads that were started in this browser, so that they can be resumed after a reload.

import type { Collection } from './target.js';

export interface Remembered {
  map: string;
  collection: Collection;
  id: number;
  /** Name of the file or folder. */
  name: string;
  bytes: number;
  /** The newest change of a file in it [ms since 1970]. */
  changedMs: number;
}

const kSlot = 'stillmap.uploads';
const kMost = 50;

export function remembered(): Remembered[] {
  try {
    const list: unknown = JSON.parse(localStorage.getItem(kSlot) ?? '[]');
    return Array.isArray(list) ? (list as Remembered[]) : [];
  } catch {
    return [];
  }
}

export function remember(upload: Remembered): void {
  store([...remembered().filter((other) => !same(other, upload)), upload].slice(-kMost));
}

export function forgetUpload(map: string, collection: Collection, id: number): void {
  store(remembered().filter((other) => !same(other, { map, collection, id })));
}

/** The upload that seems to be of this file. */
export function begunWith(
  file: Pick<Remembered, 'map' | 'collection' | 'name' | 'bytes' | 'changedMs'>, list = remembered(),
): Remembered | undefined {
  return list.find((other) => other.map === file.map && other.collection === file.collection && other.name === file.name
    && other.bytes === file.bytes && other.changedMs === file.changedMs);
}

function same(a: Pick<Remembered, 'map' | 'collection' | 'id'>, b: Pick<Remembered, 'map' | 'collection' | 'id'>): boolean {
  return a.map === b.map && a.collection === b.collection && a.id === b.id;
}

function store(list: Remembered[]): void {
  try {
    localStorage.setItem(kSlot, JSON.stringify(list));
  } catch {
    // Then only the server knows the upload.
  }
}

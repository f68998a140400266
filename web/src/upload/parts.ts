// How a file is cut into parts, and which of them are still to be sent.

export interface PartRange {
  /** From 1. */
  n: number;
  begin: number;
  end: number;
}

/** A part as the server lists it. */
export interface ListedPart {
  n: number;
  sha256: string;
  bytes: number;
}

const kMostParts = 10_000;
const kMiB = 1 << 20;
const kUsualPart = 8 * kMiB;

/** Size of a part [bytes], so that a file of `size` has at most 10000 of them. */
export function partBytesFor(size: number): number {
  return Math.max(kUsualPart, Math.ceil(size / kMostParts / kMiB) * kMiB);
}

/** All parts of a file. An empty one has none. */
export function cut(size: number, partBytes: number): PartRange[] {
  const count = Math.ceil(size / partBytes);
  return Array.from({ length: count }, (_, i) => ({
    n: i + 1, begin: i * partBytes, end: Math.min((i + 1) * partBytes, size),
  }));
}

/**
 * The size of part with which an upload that broke off was cut, from what the server has of it.
 *
 * @return undefined when that cannot be the file of `size`: then another file was begun.
 */
export function partBytesOf(listed: readonly ListedPart[], size: number): number | undefined {
  if (listed.length === 0) return partBytesFor(size);
  const largest = Math.max(...listed.map(({ bytes }) => bytes));
  const usual = partBytesFor(size);
  // Only the last part can be smaller than the others; when it alone is there, the usual size must explain it.
  const guess = fits(listed, size, usual) ? usual : largest;
  return fits(listed, size, guess) ? guess : undefined;
}

function fits(listed: readonly ListedPart[], size: number, partBytes: number): boolean {
  if (partBytes <= 0) return false;
  const parts = cut(size, partBytes);
  return listed.every(({ n, bytes }) => {
    const part = parts[n - 1];
    return part !== undefined && part.end - part.begin === bytes;
  });
}

/** What is still to be sent. */
export function missing(parts: readonly PartRange[], listed: readonly ListedPart[]): PartRange[] {
  const there = new Set(listed.map(({ n }) => n));
  return parts.filter(({ n }) => !there.has(n));
}

/** Bytes per second over the last seconds, and how long the rest takes. */
export class Speed {
  private samples_: { atMs: number; bytes: number }[] = [];

  /** @param bytes all that were sent so far. */
  note(atMs: number, bytes: number): void {
    this.samples_.push({ atMs, bytes });
    while (this.samples_.length > 2 && atMs - (this.samples_[0]?.atMs ?? 0) > 10_000) this.samples_.shift();
  }

  /** Forgets, so that a pause does not count. */
  reset(): void {
    this.samples_ = [];
  }

  /** [bytes/s]; undefined before a second has passed. */
  get bytesPerS(): number | undefined {
    const [first, last] = [this.samples_[0], this.samples_.at(-1)];
    if (first === undefined || last === undefined || last.atMs - first.atMs < 1000) return undefined;
    return Math.max(0, ((last.bytes - first.bytes) * 1000) / (last.atMs - first.atMs));
  }
}

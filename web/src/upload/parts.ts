// How a file is cut into parts, and which of them are missing.

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
 * The part size of an interrupted upload, from the parts that the server has.
 *
 * @return undefined if those cannot be of a file of `size`: then the upload is of another file.
 */
export function partBytesOf(listed: readonly ListedPart[], size: number): number | undefined {
  if (listed.length === 0) return partBytesFor(size);
  const largest = Math.max(...listed.map(({ bytes }) => bytes));
  const usual = partBytesFor(size);
  // Only the last part can be smaller than the others. If it is the only one, the usual size must fit.
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

/** The parts that are not on the server yet. */
export function missing(parts: readonly PartRange[], listed: readonly ListedPart[]): PartRange[] {
  const there = new Set(listed.map(({ n }) => n));
  return parts.filter(({ n }) => !there.has(n));
}

/** Bytes per second over the last seconds, and how long the rest takes. */
export class Speed {
  private samples_: { atMs: number; bytes: number }[] = [];

  /** @param bytes sent so far in total. */
  note(atMs: number, bytes: number): void {
    this.samples_.push({ atMs, bytes });
    while (this.samples_.length > 2 && atMs - (this.samples_[0]?.atMs ?? 0) > 10_000) this.samples_.shift();
  }

  /** Forgets the past, so that a pause does not count. */
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

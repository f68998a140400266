/** Times of the scans of a drive [ns], increasing, as decimal text. */
export interface Stamps {
  stamps_ns: string[];
  /** Where they come from, as text. */
  source: string;
}

const kUsualStep_ns = 100_000_000n;

/**
 * Stamps of `scans` scans: from a `times.txt` (seconds, one a line, KITTI's layout), else 10 a second.
 *
 * @param times  the text, or null if there is none. A text that does not fit is ignored, and `source` says so.
 */
export function stampsOf(scans: number, times: string | null): Stamps {
  const usual = Array.from({ length: scans }, (_, i) => String(BigInt(i + 1) * kUsualStep_ns));
  if (times === null) return { stamps_ns: usual, source: 'no times.txt, so 10 scans per second are assumed; add times.txt if that is wrong' };
  const lines = times.split('\n').map((line) => line.trim().split(/\s+/)[0]!).filter((word) => word !== '');
  if (lines.length < scans) {
    return { stamps_ns: usual, source: `times.txt has ${lines.length} lines for ${scans} scans and is not used: 10 scans per second are assumed; if that is wrong, correct times.txt` };
  }
  const stamps = lines.slice(0, scans).map(secondsToNs);
  const grows = stamps.every((stamp, i) => stamp !== null && (i === 0 || stamp > stamps[i - 1]!));
  if (!grows) return { stamps_ns: usual, source: 'times.txt does not contain increasing seconds and is not used: 10 scans per second are assumed; if that is wrong, correct times.txt' };
  return { stamps_ns: stamps.map(String), source: 'times.txt' };
}

/** Exact for any number of digits; numbers with exponents (KITTI writes `1.03e-01`) are read as doubles. */
function secondsToNs(text: string): bigint | null {
  const plain = /^(\d{1,12})(?:\.(\d+))?$/.exec(text);
  if (plain !== null) return BigInt(plain[1]!) * 1_000_000_000n + BigInt((plain[2] ?? '').padEnd(9, '0').slice(0, 9));
  const value = text === '' ? Number.NaN : Number(text);
  return Number.isFinite(value) && value >= 0 && value < 1e12 ? BigInt(Math.round(value * 1e6)) * 1000n : null;
}

const kByName = new Intl.Collator('en', { numeric: true });

/** Sorts files by the numbers in their names: 9.bin before 10.bin. */
export const byName = (a: { name: string }, b: { name: string }): number => kByName.compare(a.name, b.name);

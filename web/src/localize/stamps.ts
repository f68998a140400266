/** Time of each scan of a drive [ns], growing, as decimal text. */
export interface Stamps {
  stamps_ns: string[];
  /** In words, for the person. */
  source: string;
}

const kUsualStep_ns = 100_000_000n;

/**
 * Stamps of `scans` scans: from a `times.txt` (seconds, one a line, KITTI's layout), else 10 a second.
 *
 * @param times  the text, or null when none was dropped. One that does not fit is not used, and said so.
 */
export function stampsOf(scans: number, times: string | null): Stamps {
  const usual = Array.from({ length: scans }, (_, i) => String(BigInt(i + 1) * kUsualStep_ns));
  if (times === null) return { stamps_ns: usual, source: 'no times.txt: taken as 10 scans a second' };
  const lines = times.split('\n').map((line) => line.trim().split(/\s+/)[0]!).filter((word) => word !== '');
  if (lines.length < scans) {
    return { stamps_ns: usual, source: `times.txt has ${lines.length} lines for ${scans} scans: taken as 10 a second` };
  }
  const stamps = lines.slice(0, scans).map(secondsToNs);
  const grows = stamps.every((stamp, i) => stamp !== null && (i === 0 || stamp > stamps[i - 1]!));
  if (!grows) return { stamps_ns: usual, source: 'times.txt does not hold growing seconds: taken as 10 scans a second' };
  return { stamps_ns: stamps.map(String), source: 'times.txt' };
}

/** Exact for any number of digits; exponents (KITTI writes `1.03e-01`) by way of a double. */
function secondsToNs(text: string): bigint | null {
  const plain = /^(\d{1,12})(?:\.(\d+))?$/.exec(text);
  if (plain !== null) return BigInt(plain[1]!) * 1_000_000_000n + BigInt((plain[2] ?? '').padEnd(9, '0').slice(0, 9));
  const value = text === '' ? Number.NaN : Number(text);
  return Number.isFinite(value) && value >= 0 && value < 1e12 ? BigInt(Math.round(value * 1e6)) * 1000n : null;
}

const kByName = new Intl.Collator('en', { numeric: true });

/** Sorts files of a folder as their numbers go: 9.bin before 10.bin. */
export const byName = (a: { name: string }, b: { name: string }): number => kByName.compare(a.name, b.name);

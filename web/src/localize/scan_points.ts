/** The most that a scan file may hold to be shown and sent. */
export interface ScanLimits {
  maxPoints: number;
  maxBytes: number;
}

/** As many points as a server accepts by default, with up to 128 bytes each: the page holds the whole file in memory. */
export const kScanLimits: ScanLimits = { maxPoints: 2_000_000, maxBytes: 256_000_000 };

/** A file that is not a usable scan. The message names the file, what is wrong, and what to do. */
export class ScanError extends Error {
  constructor(file: string, problem: string, advice: string) {
    super(`${file}: ${problem}. ${advice}.`);
    this.name = 'ScanError';
  }
}

/** Points of one scan in the lidar frame. */
export interface ScanPoints {
  /** x, y, z [m] of each point in turn; finite, and not all zero. */
  positions: Float32Array<ArrayBuffer>;
  pointsInFile: number;
  /** Points without a return (all zero) or not finite. */
  dropped: number;
}

/** @throws ScanError when there are more points than allowed. */
export function checkPointCount(file: string, points: number, limits: ScanLimits): void {
  if (points > limits.maxPoints) {
    throw new ScanError(file, `it has ${points} points, and at most ${limits.maxPoints} are allowed`, 'Choose a single scan, not a map; thin a scan that is larger');
  }
}

/** Drops the points that are not finite or are the lidar's mark for "no return". @param xyz of each point in turn */
export function usablePoints(xyz: ArrayLike<number>): ScanPoints {
  const positions = new Float32Array(xyz.length);
  let kept = 0;
  for (let at = 0; at < xyz.length; at += 3) {
    const [x, y, z] = [xyz[at]!, xyz[at + 1]!, xyz[at + 2]!];
    if (!Number.isFinite(x + y + z) || (x === 0 && y === 0 && z === 0)) continue;
    positions.set([x, y, z], kept);
    kept += 3;
  }
  return { positions: positions.slice(0, kept), pointsInFile: xyz.length / 3, dropped: (xyz.length - kept) / 3 };
}

/** The coordinates that one of three.js's loaders found. @throws ScanError when it failed, or found another number of points. */
export function loadedPoints(file: string, count: number, load: () => ArrayLike<number>): ScanPoints {
  let xyz: ArrayLike<number>;
  try {
    xyz = load();
  } catch (error) {
    throw new ScanError(file, `its points cannot be read (${error instanceof Error ? error.message : String(error)})`, kExportAgain);
  }
  if (xyz.length !== 3 * count) {
    throw new ScanError(file, `it has ${Math.floor(xyz.length / 3)} points, and its header promises ${count}`, kExportAgain);
  }
  return usablePoints(xyz);
}

export const kExportAgain = 'The file is damaged or incomplete: copy or export it again';

/** The text of an ascii body. @throws ScanError when there is something else than numbers in it. */
export function numbersText(file: string, body: Uint8Array): string {
  const text = new TextDecoder('latin1').decode(body);
  const wrong = /[^\s\d.+\-einfaty]/i.exec(text);
  if (wrong !== null) {
    throw new ScanError(file, `its points contain '${wrong[0]}', which is not part of a number`, 'Export it again with a decimal point and blanks between numbers');
  }
  return text;
}

/** A header and what follows it as one file. */
export function joined(header: string, body: Uint8Array): ArrayBuffer {
  const head = new TextEncoder().encode(header);
  const bytes = new Uint8Array(head.length + body.length);
  bytes.set(head);
  bytes.set(body, head.length);
  return bytes.buffer;
}

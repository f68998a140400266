/** What a file of points must hold before we show it or send it. */
export interface ScanLimits {
  maxPoints: number;
}

/** As many as any server takes by default, so that a stray file of gigabytes does not end the page. */
export const kScanLimits: ScanLimits = { maxPoints: 1_000_000 };

/** A file that is no scan; the message names what was found and what was expected. */
export class ScanError extends Error {
  constructor(file: string, found: string, expected: string) {
    super(`${file}: found ${found}, expected ${expected}`);
    this.name = 'ScanError';
  }
}

/** Points of one scan in the lidar frame. */
export interface ScanPoints {
  /** x, y, z [m] one after the other; finite, none of them exactly zero. */
  positions: Float32Array<ArrayBuffer>;
  pointsInFile: number;
  /** "No return" (exactly zero) or not finite. */
  dropped: number;
}

/** @throws ScanError when there are more points than allowed. */
export function checkPointCount(file: string, points: number, limits: ScanLimits): void {
  if (!Number.isSafeInteger(points) || points > limits.maxPoints) {
    throw new ScanError(file, `${points} points`, `at most ${limits.maxPoints}`);
  }
}

/** Takes points one by one and leaves out what is none. */
export class PointCollector {
  private readonly positions: Float32Array<ArrayBuffer>;
  private kept = 0;

  constructor(private readonly pointsInFile: number) {
    this.positions = new Float32Array(3 * pointsInFile);
  }

  add(x: number, y: number, z: number): void {
    const finite = Number.isFinite(x) && Number.isFinite(y) && Number.isFinite(z);
    if (!finite || (x === 0 && y === 0 && z === 0)) return;
    this.positions.set([x, y, z], 3 * this.kept++);
  }

  finish(): ScanPoints {
    return {
      positions: this.positions.slice(0, 3 * this.kept),
      pointsInFile: this.pointsInFile,
      dropped: this.pointsInFile - this.kept,
    };
  }
}

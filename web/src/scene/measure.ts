import type { Vec3 } from './types.js';

/** Lengths [m]; `rise` is positive if the end is higher. */
export interface Lengths {
  readonly straight: number;
  readonly horizontal: number;
  readonly rise: number;
}

export function between(a: Vec3, b: Vec3): Lengths {
  const [dx, dy, dz] = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
  return { straight: Math.hypot(dx, dy, dz), horizontal: Math.hypot(dx, dy), rise: dz };
}

/** Along all segments of a line; `rise` from its first to its last point. Zero for fewer than two points. */
export function total(points: readonly Vec3[]): Lengths {
  let sum: Lengths = { straight: 0, horizontal: 0, rise: 0 };
  for (let i = 1; i < points.length; ++i) {
    const leg = between(points[i - 1] as Vec3, points[i] as Vec3);
    sum = {
      straight: sum.straight + leg.straight, horizontal: sum.horizontal + leg.horizontal, rise: sum.rise + leg.rise,
    };
  }
  return sum;
}

/** "12.34 m", "1.234 km"; millimetres would be false precision. */
export function metres(length: number): string {
  return Math.abs(length) < 1000 ? `${length.toFixed(2)} m` : `${(length / 1000).toFixed(3)} km`;
}

/** x, y, z [m]; the frame is stated where it is used. */
export type Vec3 = readonly [number, number, number];

export type Theme = 'dark' | 'light';

/** The kinds of points; their order is that of the tile format. */
export const kKinds = ['measured', 'ground', 'projected', 'filled'] as const;
export type Kind = (typeof kKinds)[number];

/** What decides the colour of a point. */
export const kColourings = ['height', 'intensity', 'kind', 'observations'] as const;
export type Colouring = (typeof kColourings)[number];

/** Ends of a colour ramp, in the unit of the values. */
export interface Range {
  readonly low: number;
  readonly high: number;
}

export function add(a: Vec3, b: Vec3): Vec3 {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

export function subtract(a: Vec3, b: Vec3): Vec3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

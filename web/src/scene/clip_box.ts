import type { Vec3 } from './types.js';

/** A box that stands upright: centre [m], length, width, height [m], heading of its length from +x [rad]. */
export interface Box {
  readonly centre: Vec3;
  readonly size: Vec3;
  readonly yaw: number;
}

/** Whether a clip box shows its inside or its outside. */
export type ClipMode = 'inside' | 'outside';

/** Whether a point is in the box, faces included. Same frame as the box. */
export function contains(box: Box, x: number, y: number, z: number): boolean {
  const [cos, sin] = [Math.cos(box.yaw), Math.sin(box.yaw)];
  const [dx, dy, dz] = [x - box.centre[0], y - box.centre[1], z - box.centre[2]];
  return (
    2 * Math.abs(cos * dx + sin * dy) <= box.size[0] &&
    2 * Math.abs(cos * dy - sin * dx) <= box.size[1] &&
    2 * Math.abs(dz) <= box.size[2]
  );
}

/** The box as column-major 4 x 4 matrix that takes it to the cube of side 1 about 0. */
export function toUnitCube({ centre, size, yaw }: Box): number[] {
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  const rows = [
    [cos / size[0], sin / size[0], 0],
    [-sin / size[1], cos / size[1], 0],
    [0, 0, 1 / size[2]],
  ] as const;
  const shift = rows.map((row) => -(row[0] * centre[0] + row[1] * centre[1] + row[2] * centre[2]));
  return [
    rows[0][0], rows[1][0], rows[2][0], 0, rows[0][1], rows[1][1], rows[2][1], 0,
    rows[0][2], rows[1][2], rows[2][2], 0, shift[0] as number, shift[1] as number, shift[2] as number, 1,
  ];
}

/** The 8 corners: the bottom counter-clockwise, then the top. */
export function corners({ centre, size, yaw }: Box): Vec3[] {
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  return [-0.5, 0.5].flatMap((h) => [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(([l, w]): Vec3 => {
    const [along, across] = [(l as number) * size[0], (w as number) * size[1]];
    return [centre[0] + cos * along - sin * across, centre[1] + sin * along + cos * across, centre[2] + h * size[2]];
  }));
}

/** Whether a box and an axis-aligned box may overlap. Can be true without an overlap, but never false with one. */
export function mayTouch(box: Box, min: Vec3, max: Vec3): boolean {
  const points = corners(box);
  for (let axis = 0; axis < 3; ++axis) {
    const values = points.map((point) => point[axis] as number);
    if (Math.min(...values) > (max[axis] as number) || Math.max(...values) < (min[axis] as number)) return false;
  }
  // The box's own horizontal axes.
  for (const angle of [box.yaw, box.yaw + Math.PI / 2]) {
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    const half = (angle === box.yaw ? box.size[0] : box.size[1]) / 2;
    const centre = cos * box.centre[0] + sin * box.centre[1];
    const seen = [min[0], max[0]].flatMap((x) => [min[1], max[1]].map((y) => cos * x + sin * y));
    if (Math.min(...seen) > centre + half || Math.max(...seen) < centre - half) return false;
  }
  return true;
}

/** The upright box with two places on the ground as opposite corners, or around the line between them. */
export function boxOverDiagonal(a: Vec3, b: Vec3, below: number, above: number): Box {
  const low = Math.min(a[2], b[2]) - below;
  const high = Math.max(a[2], b[2]) + above;
  return {
    centre: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (low + high) / 2],
    size: [Math.max(Math.abs(a[0] - b[0]), 0.5), Math.max(Math.abs(a[1] - b[1]), 0.5), high - low],
    yaw: 0,
  };
}

/** Distance along a ray (direction of length 1) to the box [m]; 0 from inside, undefined if the ray misses it. */
export function metBy({ centre, size, yaw }: Box, origin: Vec3, direction: Vec3): number | undefined {
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  const turn = ([x, y, z]: Vec3): Vec3 => [cos * x + sin * y, cos * y - sin * x, z];
  const from = turn([origin[0] - centre[0], origin[1] - centre[1], origin[2] - centre[2]]);
  const along = turn(direction);
  let [enter, leave] = [0, Infinity];
  for (let axis = 0; axis < 3; ++axis) {
    const half = (size[axis] as number) / 2;
    const a = (-half - (from[axis] as number)) / (along[axis] as number);
    const b = (half - (from[axis] as number)) / (along[axis] as number);
    // Parallel to these faces: NaN when on one of them, which counts as inside.
    enter = Math.max(enter, Number.isNaN(a) ? 0 : Math.min(a, b));
    leave = Math.min(leave, Number.isNaN(b) ? Infinity : Math.max(a, b));
  }
  return enter <= leave ? enter : undefined;
}

import type { Box } from './clip_box.js';
import type { Ray } from './pick.js';
import { add, subtract, type Vec3 } from './types.js';

/** A handle of a box: the middle of a face moves that face; the middle of the box moves the box horizontally. */
export interface Handle {
  readonly place: Vec3;
  /** Outwards from the face, of length 1; undefined for the middle of the box. */
  readonly normal?: Vec3;
  /** Of the box's size. */
  readonly axis: 0 | 1 | 2;
}

const kLeastSizeM = 0.1;
/** Cosine between a face's normal and the line of sight above which a drag would be ambiguous. */
const kAlong = 0.95;

/** The handles of a box: two faces of each axis, and the middle. */
export function handlesOf(box: Box): Handle[] {
  const [cos, sin] = [Math.cos(box.yaw), Math.sin(box.yaw)];
  const axes: readonly Vec3[] = [[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]];
  const faces = ([0, 1, 2] as const).flatMap((axis) => [1, -1].map((side): Handle => {
    const normal = times(axes[axis] as Vec3, side);
    return { axis, normal, place: add(box.centre, times(normal, box.size[axis] / 2)) };
  }));
  return [...faces, { axis: 2, place: box.centre }];
}

/** Whether a handle can be dragged when looking along `direction` (of length 1). */
export function canPull({ normal }: Handle, direction: Vec3): boolean {
  return normal === undefined ? direction[2] !== 0 : Math.abs(dot(normal, direction)) < kAlong;
}

/**
 * The box after its handle was dragged to a ray; same frame as the ray.
 *
 * A face moves along its normal, to at least 0.1 m from the opposite face. The middle keeps its height.
 */
export function pulled(box: Box, handle: Handle, ray: Ray): Box {
  if (!canPull(handle, ray.direction)) return box;
  const { normal, axis, place } = handle;
  if (normal === undefined) {
    const depth = (place[2] - ray.origin[2]) / ray.direction[2];
    return depth > 0 ? { ...box, centre: add(ray.origin, times(ray.direction, depth)) } : box;
  }
  const by = Math.max(nearestOn(place, normal, ray), kLeastSizeM - box.size[axis]);
  const size = box.size.map((length, i) => (i === axis ? length + by : length)) as unknown as Vec3;
  return { ...box, size, centre: add(box.centre, times(normal, by / 2)) };
}

/** Distance along a line (through `place`, along `normal`) where it is closest to a ray. */
function nearestOn(place: Vec3, normal: Vec3, { origin, direction }: Ray): number {
  const between = subtract(place, origin);
  const cosine = dot(normal, direction);
  return (cosine * dot(direction, between) - dot(normal, between)) / (1 - cosine * cosine);
}

function dot(a: Vec3, b: Vec3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function times([x, y, z]: Vec3, by: number): Vec3 {
  return [x * by, y * by, z * by];
}

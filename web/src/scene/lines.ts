import * as THREE from 'three';
import { corners, type Box } from './clip_box.js';
import type { Vec3 } from './types.js';

const kEdges: readonly number[] = [0, 1, 1, 2, 2, 3, 3, 0, 4, 5, 5, 6, 6, 7, 7, 4, 0, 4, 1, 5, 2, 6, 3, 7];

/** Ends of the 12 edges of boxes: x, y, z in turn, relative to `origin`; 72 numbers per box. */
export function boxEdges(boxes: readonly Box[], origin: Vec3): Float32Array {
  const ends = new Float32Array(boxes.length * 3 * kEdges.length);
  let at = 0;
  for (const box of boxes) {
    const points = corners(box);
    for (const index of kEdges) {
      for (let axis = 0; axis < 3; ++axis) ends[at++] = ((points[index] as Vec3)[axis] as number) - (origin[axis] as number);
    }
  }
  return ends;
}

/** Positions in turn, relative to `origin`. */
export function flat(places: readonly Vec3[], origin: Vec3): Float32Array {
  const values = new Float32Array(3 * places.length);
  places.forEach((place, i) => place.forEach((value, axis) => (values[3 * i + axis] = value - (origin[axis] as number))));
  return values;
}

/** Removes everything from a group and frees its memory. */
export function empty(group: THREE.Group): void {
  group.traverse((object) => {
    const { geometry, material } = object as THREE.Mesh;
    geometry?.dispose();
    for (const one of material === undefined ? [] : [material].flat()) one.dispose();
  });
  group.clear();
}

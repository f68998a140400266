import * as THREE from 'three';
import type { Box, ClipMode } from './clip_box.js';

export interface Clip {
  readonly box: Box;
  readonly mode: ClipMode;
}

/** The planes of a box's faces; the box is on the positive side of all of them. Same frame as the box. */
export function planesOf({ centre, size, yaw }: Box): THREE.Plane[] {
  const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
  const axes = [new THREE.Vector3(cos, sin, 0), new THREE.Vector3(-sin, cos, 0), new THREE.Vector3(0, 0, 1)];
  const middle = new THREE.Vector3(...centre);
  return axes.flatMap((axis, i) => [-1, 1].map((side) => {
    const normal = axis.clone().multiplyScalar(side);
    return new THREE.Plane(normal, (size[i] as number) / 2 - normal.dot(middle));
  }));
}

/** Clips everything in a group as the points are clipped. @param clip in the frame of the scene; undefined clips nothing */
export function cut(group: THREE.Object3D, clip: Clip | undefined): void {
  const inside = clip?.mode === 'inside';
  const planes = clip === undefined ? null : planesOf(clip.box).map((plane) => (inside ? plane : plane.negate()));
  group.traverse((object) => {
    const { material } = object as THREE.Mesh;
    for (const one of material === undefined ? [] : [material].flat()) {
      one.clippingPlanes = planes;
      // A point behind all planes is inside the box.
      one.clipIntersection = !inside;
    }
  });
}

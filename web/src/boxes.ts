/** A box in map coordinates: centre [m], length, width, height [m], heading from +x counter-clockwise [rad]. */
export interface Box {
  readonly centre: readonly [number, number, number];
  readonly size: readonly [number, number, number];
  readonly yaw: number;
}

const kCorners: readonly (readonly [number, number, number])[] = [
  [-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1],
];
const kEdges: readonly number[] = [0, 1, 1, 2, 2, 3, 3, 0, 4, 5, 5, 6, 6, 7, 7, 4, 0, 4, 1, 5, 2, 6, 3, 7];

/** Ends of the 12 edges of every box: x, y, z [m] one after the other, relative to `origin`; 72 numbers a box. */
export function boxEdges(boxes: readonly Box[], origin: readonly [number, number, number]): Float32Array {
  const ends = new Float32Array(boxes.length * kEdges.length * 3);
  let at = 0;
  for (const box of boxes) {
    const [cos, sin] = [Math.cos(box.yaw), Math.sin(box.yaw)];
    for (const corner of kEdges.map((index) => kCorners[index] as readonly [number, number, number])) {
      const x = (corner[0] * box.size[0]) / 2;
      const y = (corner[1] * box.size[1]) / 2;
      ends[at++] = box.centre[0] - origin[0] + cos * x - sin * y;
      ends[at++] = box.centre[1] - origin[1] + sin * x + cos * y;
      ends[at++] = box.centre[2] - origin[2] + (corner[2] * box.size[2]) / 2;
    }
  }
  return ends;
}

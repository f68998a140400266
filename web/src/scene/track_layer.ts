import * as THREE from 'three';
import { Line2 } from 'three/examples/jsm/lines/Line2.js';
import { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
import { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
import { LineSegments2 } from 'three/examples/jsm/lines/LineSegments2.js';
import { LineSegmentsGeometry } from 'three/examples/jsm/lines/LineSegmentsGeometry.js';
import { empty, flat } from './lines.js';
import type { Theme, Vec3 } from './types.js';

export interface TrackPose {
  readonly drive: number;
  readonly position: Vec3;
}

/** A loop closure between two poses, by number, and its weight in the pose graph, in [0, 1]. */
export interface Loop {
  readonly from: number;
  readonly to: number;
  readonly weight: number;
}

export const kTrackColours: Record<Theme, { trajectory: number; keyframes: number; loops: number }> = {
  dark: { trajectory: 0xffffff, keyframes: 0xffd166, loops: 0x5ee6ff },
  light: { trajectory: 0x14181f, keyframes: 0xa35c00, loops: 0x006c8c },
};

/** The trajectory with keyframes and loop closures. Points do not hide it, since trees are above it. */
export class TrackLayer {
  readonly trajectory = new THREE.Group();
  readonly keyframes = new THREE.Group();
  readonly loops = new THREE.Group();

  /** @param origin of the scene, map coordinates [m]. */
  constructor(private readonly origin_: Vec3) {}

  /** @param keyframes numbers of poses. */
  show(poses: readonly TrackPose[], keyframes: readonly number[], loops: readonly Loop[], theme: Theme): void {
    [this.trajectory, this.keyframes, this.loops].forEach(empty);
    const colours = kTrackColours[theme];
    for (const drive of new Set(poses.map((pose) => pose.drive))) {
      const line = poses.filter((pose) => pose.drive === drive).map(({ position }) => position);
      if (line.length > 1) this.trajectory.add(this.line(line, colours.trajectory));
    }
    const places = keyframes.flatMap((number) => poses[number] ?? []).map(({ position }) => position);
    if (places.length > 0) this.keyframes.add(this.dots(places, colours.keyframes));
    const ends = loops.flatMap(({ from, to }) => {
      const [a, b] = [poses[from], poses[to]];
      return a === undefined || b === undefined ? [] : [a.position, b.position];
    });
    if (ends.length > 0) this.loops.add(this.segments(ends, colours.loops));
  }

  private line(places: readonly Vec3[], colour: number): Line2 {
    const material = new LineMaterial({ color: colour, linewidth: 3, depthTest: false, transparent: true, opacity: 0.85 });
    const line = new Line2(new LineGeometry().setPositions(flat(places, this.origin_)), material);
    line.renderOrder = 1;
    line.frustumCulled = false;
    return line;
  }

  private dots(places: readonly Vec3[], colour: number): THREE.Points {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(flat(places, this.origin_), 3));
    const material = new THREE.PointsMaterial({ color: colour, size: 7 * Math.min(window.devicePixelRatio, 2), sizeAttenuation: false, depthTest: false });
    const dots = new THREE.Points(geometry, material);
    dots.renderOrder = 3;
    dots.frustumCulled = false;
    return dots;
  }

  private segments(ends: readonly Vec3[], colour: number): LineSegments2 {
    const material = new LineMaterial({ color: colour, linewidth: 2, depthTest: false, transparent: true, opacity: 0.9 });
    const lines = new LineSegments2(new LineSegmentsGeometry().setPositions(flat(ends, this.origin_)), material);
    lines.renderOrder = 2;
    lines.frustumCulled = false;
    return lines;
  }
}

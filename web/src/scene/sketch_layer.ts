import * as THREE from 'three';
import { Line2 } from 'three/examples/jsm/lines/Line2.js';
import { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
import { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
import { LineSegments2 } from 'three/examples/jsm/lines/LineSegments2.js';
import { LineSegmentsGeometry } from 'three/examples/jsm/lines/LineSegmentsGeometry.js';
import type { Box } from './clip_box.js';
import { handlesOf } from './clip_handles.js';
import { boxEdges, empty, flat } from './lines.js';
import type { Theme, Vec3 } from './types.js';

const kColours: Record<Theme, number> = { dark: 0xffe066, light: 0x8a4b00 };

/** The measured line and the clip box, drawn in front of everything. */
export class SketchLayer {
  readonly group = new THREE.Group();
  private readonly lines_ = new THREE.Group();
  private readonly boxes_ = new THREE.Group();

  /** @param origin of the scene, map coordinates [m]. */
  constructor(private readonly origin_: Vec3) {
    this.group.add(this.lines_, this.boxes_);
  }

  setLine(places: readonly Vec3[], theme: Theme): void {
    empty(this.lines_);
    if (places.length > 1) {
      const material = new LineMaterial({ color: kColours[theme], linewidth: 2.5, depthTest: false, transparent: true });
      this.lines_.add(inFront(new Line2(new LineGeometry().setPositions(flat(places, this.origin_)), material)));
    }
    if (places.length > 0) this.lines_.add(this.dots(places, 9, theme));
  }

  /** @param held whether it has handles. */
  setBox(box: Box | undefined, held: boolean, theme: Theme): void {
    empty(this.boxes_);
    if (box === undefined) return;
    const material = new LineMaterial({ color: kColours[theme], linewidth: 2, transparent: true, opacity: 0.9 });
    this.boxes_.add(new LineSegments2(new LineSegmentsGeometry().setPositions(boxEdges([box], this.origin_)), material));
    if (held) this.boxes_.add(this.dots(handlesOf(box).map(({ place }) => place), 11, theme));
  }

  private dots(places: readonly Vec3[], px: number, theme: Theme): THREE.Points {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(flat(places, this.origin_), 3));
    const size = px * Math.min(window.devicePixelRatio, 2);
    const material = new THREE.PointsMaterial({ color: kColours[theme], size, sizeAttenuation: false, depthTest: false, transparent: true });
    return inFront(new THREE.Points(geometry, material));
  }
}

function inFront<Object extends THREE.Object3D>(object: Object): Object {
  object.renderOrder = 5;
  object.frustumCulled = false;
  return object;
}

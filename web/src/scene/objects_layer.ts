import * as THREE from 'three';
import { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
import { LineSegments2 } from 'three/examples/jsm/lines/LineSegments2.js';
import { LineSegmentsGeometry } from 'three/examples/jsm/lines/LineSegmentsGeometry.js';
import { contains, metBy, type Box } from './clip_box.js';
import type { Clip } from './clip_planes.js';
import { boxEdges, empty, flat } from './lines.js';
import type { Ray } from './pick.js';
import type { SeenObject } from './seen_objects.js';
import { kDecisionColours, objectColour, type Decision } from './object_colours.js';
import { add, type Theme, type Vec3 } from './types.js';

/**
 * Boxes of removed objects, coloured by class, with the tracks of moving ones.
 *
 * A moving object has one box and its track; a selected one all of its boxes.
 */
export class ObjectsLayer {
  readonly group = new THREE.Group();
  private readonly chosenGroup_ = new THREE.Group();
  private shown_: readonly SeenObject[] = [];
  private decisions_: ReadonlyMap<number, Decision> = new Map();
  private theme_: Theme = 'dark';
  private clip_: Clip | undefined;

  /** @param origin of the scene, map coordinates [m]. */
  constructor(private readonly origin_: Vec3) {}

  /** @param objects whose boxes are drawn. */
  show(objects: readonly SeenObject[], decisions: ReadonlyMap<number, Decision>, theme: Theme): void {
    this.shown_ = objects;
    this.decisions_ = decisions;
    this.theme_ = theme;
    this.chosenGroup_.removeFromParent();
    empty(this.group);
    const boxes = objects.map(shownBox);
    this.group.add(this.edges(boxes, objects.map((object) => this.colourOf(object)), 1.6));
    this.group.add(this.faces(boxes, objects.map((object) => this.colourOf(object))));
    for (const object of objects.filter(({ places }) => places.length > 1)) this.group.add(this.track(object));
    this.group.add(this.chosenGroup_);
  }

  /** Highlights an object with all its positions; undefined for none. */
  choose(object: SeenObject | undefined): void {
    empty(this.chosenGroup_);
    if (object === undefined) return;
    const colour = new THREE.Color(this.theme_ === 'dark' ? 0xffffff : 0x10141a);
    if (object.places.length > 1) {
      this.chosenGroup_.add(this.edges(object.places, object.places.map(() => this.colourOf(object)), 1));
    }
    this.chosenGroup_.add(this.edges([shownBox(object)], [colour], 3));
  }

  /** Boxes whose middle is cut away cannot be picked. @param clip in map coordinates */
  setClip(clip: Clip | undefined): void {
    this.clip_ = clip;
  }

  /** The object whose box a ray (relative to `origin`) meets first, and the distance along the ray [m]. */
  pick(ray: Ray): { object: SeenObject; depth: number } | undefined {
    let best: { object: SeenObject; depth: number } | undefined;
    const from = add(ray.origin, this.origin_);
    for (const object of this.group.visible ? this.shown_ : []) {
      const box = shownBox(object);
      if (this.clip_ !== undefined && contains(this.clip_.box, ...box.centre) !== (this.clip_.mode === 'inside')) continue;
      const depth = metBy(box, from, ray.direction);
      if (depth !== undefined && depth > 0 && (best === undefined || depth < best.depth)) best = { object, depth };
    }
    return best;
  }

  private colourOf(object: SeenObject): THREE.Color {
    const decision = this.decisions_.get(object.number);
    return new THREE.Color(decision === undefined ? objectColour(object.class, this.theme_) : kDecisionColours[this.theme_][decision]);
  }

  private edges(boxes: readonly Box[], colours: readonly THREE.Color[], width: number): LineSegments2 {
    const geometry = new LineSegmentsGeometry().setPositions(boxEdges(boxes, this.origin_));
    geometry.setColors(new Float32Array(colours.flatMap(({ r, g, b }) => Array.from({ length: 24 }, () => [r, g, b]).flat())));
    const lines = new LineSegments2(geometry, new LineMaterial({ linewidth: width, vertexColors: true, alphaToCoverage: true }));
    lines.frustumCulled = false;
    return lines;
  }

  private faces(boxes: readonly Box[], colours: readonly THREE.Color[]): THREE.InstancedMesh {
    const material = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.13, depthWrite: false });
    const mesh = new THREE.InstancedMesh(new THREE.BoxGeometry(), material, boxes.length);
    const turn = new THREE.Quaternion();
    boxes.forEach(({ centre, size, yaw }, i) => {
      const [x, y, z] = [0, 1, 2].map((axis) => (centre[axis] as number) - (this.origin_[axis] as number)) as [number, number, number];
      turn.setFromAxisAngle(new THREE.Vector3(0, 0, 1), yaw);
      mesh.setMatrixAt(i, new THREE.Matrix4().compose(new THREE.Vector3(x, y, z), turn, new THREE.Vector3(...size)));
      mesh.setColorAt(i, colours[i] as THREE.Color);
    });
    mesh.frustumCulled = false;
    return mesh;
  }

  private track(object: SeenObject): THREE.Line {
    const low = object.places.map(({ centre, size }): Vec3 => [centre[0], centre[1], centre[2] - size[2] / 2 + 0.1]);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(flat(low, this.origin_), 3));
    return new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: this.colourOf(object), transparent: true, opacity: 0.85 }));
  }
}

/** The box in the middle of an object's positions. */
export function shownBox({ places }: SeenObject): Box {
  return places[Math.floor(places.length / 2)] as Box;
}

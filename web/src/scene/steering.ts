import * as THREE from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { fitView } from './fit.js';
import { steer } from './keyboard.js';
import { add, subtract, type Vec3 } from './types.js';

/** Where from and where to; map coordinates [m]. */
export interface View {
  readonly eye: Vec3;
  readonly target: Vec3;
}

const kElevation = (50 * Math.PI) / 180;
// Not quite 90 degrees: there "up" would have no direction.
const kStraightDown = 0.4999 * Math.PI;
const kFovDeg = 45;
/** As good as parallel rays, with the same camera. */
const kPlanFovDeg = 4;
const kRestMs = 250;
const kFlightMs = 350;

/** The camera, and how people move it: pointer, touch, keys, or a flight to a place. */
export class Steering {
  readonly camera = new THREE.PerspectiveCamera(kFovDeg, 1, 0.1, 1000);
  private readonly controls_: OrbitControls;
  private readonly listeners_ = new Set<(view: View) => void>();
  private flight_: { from: View; to: View; begin: number } | undefined;
  private restTimer_: ReturnType<typeof setTimeout> | undefined;
  private moving_ = false;
  private widthShare_ = 1;

  /**
   * @param origin map coordinates of the camera's zero.
   * @param shape  corners of what there is to see, map coordinates.
   * @param onMove told at each movement, and once more when it has ended.
   */
  constructor(
    canvas: HTMLCanvasElement,
    private readonly origin_: Vec3,
    private readonly shape_: () => readonly Vec3[],
    private readonly onMove_: () => void,
  ) {
    this.camera.up.set(0, 0, 1);
    this.controls_ = new OrbitControls(this.camera, canvas);
    // Never from below the ground.
    this.controls_.maxPolarAngle = 0.495 * Math.PI;
    this.controls_.zoomToCursor = true;
    this.controls_.addEventListener('change', () => this.moved());
  }

  /** True from a movement until shortly after the last one. */
  get moving(): boolean {
    return this.moving_;
  }

  /** Whether pointer and touch move the camera. */
  set enabled(on: boolean) {
    this.controls_.enabled = on;
  }

  /** Of the canvas, that one picture fills. */
  set widthShare(share: number) {
    this.widthShare_ = share;
    // The controls know of one picture only, whose middle is not that of several.
    this.controls_.zoomToCursor = share === 1;
  }

  get view(): View {
    return { eye: this.toMap(this.camera.position), target: this.toMap(this.controls_.target) };
  }

  setView(view: View): void {
    this.camera.position.copy(this.toLocal(view.eye));
    this.controls_.target.copy(this.toLocal(view.target));
    this.controls_.update();
    this.moved();
  }

  /** @return takes the listener away again. Called when the camera has come to rest. */
  onRest(listener: (view: View) => void): () => void {
    this.listeners_.add(listener);
    return () => this.listeners_.delete(listener);
  }

  /** All of the shape, from above at an angle, or straight down; `plan` without perspective. */
  showAll(from: 'aslant' | 'above' | 'plan'): void {
    const shape = this.shape_().map((corner) => subtract(corner, this.origin_));
    if (shape.length === 0) return;
    this.flight_ = undefined;
    this.camera.fov = from === 'plan' ? kPlanFovDeg : kFovDeg;
    this.camera.updateProjectionMatrix();
    const elevation = from === 'aslant' ? kElevation : kStraightDown;
    const view = fitView(shape, (this.camera.fov * Math.PI) / 180, this.camera.aspect * this.widthShare_, elevation);
    this.camera.position.set(...view.eye);
    this.controls_.target.set(...view.target);
    this.controls_.minDistance = 0.5;
    this.controls_.maxDistance = 4 * this.camera.position.distanceTo(this.controls_.target);
    this.controls_.update();
    this.moved();
  }

  /** Brings a place into the middle, seen from a few radii away, in the direction of before. */
  lookAt(place: Vec3, radiusM: number): void {
    const { eye, target } = this.view;
    const away = subtract(eye, target);
    const scale = (2.8 * radiusM) / (Math.tan((this.camera.fov * Math.PI) / 360) * Math.hypot(...away));
    this.flyTo({ target: place, eye: add(place, [away[0] * scale, away[1] * scale, away[2] * scale]) });
  }

  /** Glides there, unless the person wants less motion. */
  flyTo(view: View): void {
    if (window.matchMedia('(prefers-reduced-motion: reduce)').matches) return this.setView(view);
    this.flight_ = { from: this.view, to: view, begin: performance.now() };
    this.onMove_();
  }

  onKey(event: KeyboardEvent): void {
    const move = steer(event);
    if (move === undefined) return;
    event.preventDefault();
    if (move === 'all') return this.showAll('aslant');
    if (move === 'above') return this.showAll('above');
    move(this.camera, this.controls_.target, this.controls_);
    this.controls_.update();
    this.moved();
  }

  /** Before each frame: goes on with a flight, and sets the depths that `bounds` (map coordinates) need. */
  prepare(now: number, bounds: readonly { min: Vec3; max: Vec3 }[]): void {
    this.fly(now);
    const eye = this.camera.position;
    const reach = eye.distanceTo(this.controls_.target);
    let far = 2 * reach + 10;
    for (const { min, max } of bounds) {
      const [low, high] = [this.toLocal(min), this.toLocal(max)];
      far = Math.max(far, eye.distanceTo(low.clone().add(high).multiplyScalar(0.5)) + 0.6 * low.distanceTo(high));
    }
    // As near as the depths in between still are told apart.
    this.camera.near = Math.max(far / 20_000, 0.02 * reach, 0.05);
    this.camera.far = far;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
  }

  toLocal(place: Vec3): THREE.Vector3 {
    return new THREE.Vector3(...subtract(place, this.origin_));
  }

  toMap({ x, y, z }: THREE.Vector3): Vec3 {
    return add([x, y, z], this.origin_);
  }

  dispose(): void {
    clearTimeout(this.restTimer_);
    this.controls_.dispose();
  }

  private fly(now: number): void {
    if (this.flight_ === undefined) return;
    const { from, to, begin } = this.flight_;
    const share = Math.min((now - begin) / kFlightMs, 1);
    const eased = share * share * (3 - 2 * share);
    const mix = (a: Vec3, b: Vec3): Vec3 => [0, 1, 2].map((axis) =>
      (a[axis] as number) + ((b[axis] as number) - (a[axis] as number)) * eased) as unknown as Vec3;
    if (share >= 1) this.flight_ = undefined;
    this.setView({ eye: mix(from.eye, to.eye), target: mix(from.target, to.target) });
  }

  private moved(): void {
    this.moving_ = true;
    clearTimeout(this.restTimer_);
    this.restTimer_ = setTimeout(() => {
      this.moving_ = false;
      this.onMove_();
      for (const listener of this.listeners_) listener(this.view);
    }, kRestMs);
    this.onMove_();
  }
}

import * as THREE from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { fitView } from './fit.js';
import { steer } from './keyboard.js';
import { add, subtract, type Vec3 } from './types.js';

/** Position of the eye and its target; map coordinates [m]. */
export interface View {
  readonly eye: Vec3;
  readonly target: Vec3;
}

const kElevation = (50 * Math.PI) / 180;
// Less than 90 degrees: straight down, "up" would have no direction.
const kStraightDown = 0.4999 * Math.PI;
const kFovDeg = 45;
/** Within this angle of straight down, the projection is parallel [rad]. Too small to happen by chance. */
const kPlanPolar = 0.01;
const kRestMs = 250;
const kFlightMs = 350;

/** What a picture is drawn with. */
export type Lens = THREE.PerspectiveCamera | THREE.OrthographicCamera;

/**
 * The camera and its control by pointer, touch and keys, and animated moves.
 *
 * The camera has perspective. Straight down it has a parallel projection, so that the picture is a plan. At the height
 * of the target both show the same, so that control, zoom and addresses are the same for both.
 */
export class Steering {
  private readonly camera_ = new THREE.PerspectiveCamera(kFovDeg, 1, 0.1, 1000);
  private readonly plan_ = new THREE.OrthographicCamera();
  private lens_: Lens = this.camera_;
  private readonly controls_: OrbitControls;
  private readonly listeners_ = new Set<(view: View) => void>();
  private flight_: { from: View; to: View; begin: number } | undefined;
  private restTimer_: ReturnType<typeof setTimeout> | undefined;
  private moving_ = false;
  private widthShare_ = 1;

  /**
   * @param origin of the camera's frame in map coordinates.
   * @param shape  corners of everything that can be seen, map coordinates.
   * @param onMove called at each movement, and once more when it has ended.
   */
  constructor(
    canvas: HTMLCanvasElement,
    private readonly origin_: Vec3,
    private readonly shape_: () => readonly Vec3[],
    private readonly onMove_: () => void,
  ) {
    this.camera_.up.set(0, 0, 1);
    this.controls_ = new OrbitControls(this.camera_, canvas);
    // Never from below the ground.
    this.controls_.maxPolarAngle = 0.495 * Math.PI;
    this.controls_.zoomToCursor = true;
    this.controls_.addEventListener('change', () => this.moved());
  }

  /** As of the latest `prepare`. */
  get lens(): Lens {
    return this.lens_;
  }

  /** Half of the vertical opening angle [rad]; of the perspective that the plan agrees with too. */
  get halfFov(): number {
    return (this.camera_.fov * Math.PI) / 360;
  }

  /** Width by height of the picture. */
  set aspect(aspect: number) {
    this.camera_.aspect = aspect;
    this.camera_.updateProjectionMatrix();
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
    // The controls assume one picture, whose centre is not the centre of one of several.
    this.controls_.zoomToCursor = share === 1;
  }

  get view(): View {
    return { eye: this.toMap(this.camera_.position), target: this.toMap(this.controls_.target) };
  }

  setView(view: View): void {
    this.camera_.position.copy(this.toLocal(view.eye));
    this.controls_.target.copy(this.toLocal(view.target));
    this.controls_.update();
    this.moved();
  }

  /** @return removes the listener. Called when the camera has come to rest. */
  onRest(listener: (view: View) => void): () => void {
    this.listeners_.add(listener);
    return () => this.listeners_.delete(listener);
  }

  /** All of the shape, from above at an angle, or straight down. */
  showAll(from: 'aslant' | 'above'): void {
    const corners = this.shape_().map((corner) => subtract(corner, this.origin_));
    // A plan shows all heights alike.
    const middle = corners.reduce((sum, corner) => sum + corner[2], 0) / corners.length;
    const shape = from === 'above' ? corners.map(([x, y]): Vec3 => [x, y, middle]) : corners;
    if (shape.length === 0) return;
    this.flight_ = undefined;
    const elevation = from === 'aslant' ? kElevation : kStraightDown;
    const view = fitView(shape, 2 * this.halfFov, this.camera_.aspect * this.widthShare_, elevation);
    this.camera_.position.set(...view.eye);
    this.controls_.target.set(...view.target);
    this.controls_.minDistance = 0.5;
    this.controls_.maxDistance = 4 * this.camera_.position.distanceTo(this.controls_.target);
    this.controls_.update();
    this.moved();
  }

  /** Moves the camera to a few radii from a place, in the present direction. */
  lookAt(place: Vec3, radiusM: number): void {
    const { eye, target } = this.view;
    const away = subtract(eye, target);
    const scale = (2.8 * radiusM) / (Math.tan(this.halfFov) * Math.hypot(...away));
    this.flyTo({ target: place, eye: add(place, [away[0] * scale, away[1] * scale, away[2] * scale]) });
  }

  /** Moves there with an animation, unless the person prefers less motion. */
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
    move(this.camera_, this.controls_.target, this.controls_);
    this.controls_.update();
    this.moved();
  }

  /** Before each frame: continues an animation, and sets the depth range for `bounds` (map coordinates). */
  prepare(now: number, bounds: readonly { min: Vec3; max: Vec3 }[]): void {
    this.fly(now);
    const eye = this.camera_.position;
    const reach = eye.distanceTo(this.controls_.target);
    let far = 2 * reach + 10;
    for (const { min, max } of bounds) {
      const [low, high] = [this.toLocal(min), this.toLocal(max)];
      far = Math.max(far, eye.distanceTo(low.clone().add(high).multiplyScalar(0.5)) + 0.6 * low.distanceTo(high));
    }
    // As near as the depth resolution allows.
    this.camera_.near = Math.max(far / 20_000, 0.02 * reach, 0.05);
    this.camera_.far = far;
    this.camera_.updateProjectionMatrix();
    this.camera_.updateMatrixWorld();
    const isPlan = this.controls_.getPolarAngle() < kPlanPolar;
    this.lens_ = isPlan ? this.plan_ : this.camera_;
    if (isPlan) this.layPlan(reach);
  }

  private layPlan(reach: number): void {
    const { position, quaternion, near, far, aspect } = this.camera_;
    const half = reach * Math.tan(this.halfFov);
    Object.assign(this.plan_, { left: -half * aspect, right: half * aspect, top: half, bottom: -half, near, far });
    this.plan_.position.copy(position);
    this.plan_.quaternion.copy(quaternion);
    this.plan_.updateProjectionMatrix();
    this.plan_.updateMatrixWorld();
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

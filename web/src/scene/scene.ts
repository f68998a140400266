import * as THREE from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { EyeDome } from './eye_dome.js';
import { fitView } from './fit.js';
import { FrameLoop, type FrameCosts } from './frame_loop.js';
import { steer } from './keyboard.js';
import type { MapCloud, PickedPoint } from './map_cloud.js';
import { Pointers, type Tool } from './pointers.js';
import type { Ray } from './pick.js';
import { add, subtract, type Theme, type Vec3 } from './types.js';

/** Where from and where to; map coordinates [m]. */
export interface View {
  readonly eye: Vec3;
  readonly target: Vec3;
}

/** A place that a person points at; map coordinates [m]. */
export interface Pick {
  readonly position: Vec3;
  /** The point there; undefined when only the ground plane was met. */
  readonly point?: PickedPoint;
  readonly cloud?: MapCloud;
}

/** `auto` draws less while the camera moves, on machines that need it. */
export type Quality = 'auto' | 'full' | 'reduced';

/** Two pictures side by side, from one eye; `share` of the width is left. */
export interface Split {
  readonly left: readonly MapCloud[];
  readonly right: readonly MapCloud[];
  readonly share: number;
}

export const kBackgrounds: Record<Theme, number> = { dark: 0x0f1318, light: 0xf4f6f8 };
const kElevation = (50 * Math.PI) / 180;
// Not quite 90 degrees: there "up" would have no direction.
const kStraightDown = 0.4999 * Math.PI;
const kFovDeg = 45;
/** As good as parallel rays, with the same camera. */
const kPlanFovDeg = 4;
const kPickPx = 7;
const kSlowFrameMs = 70;
const kRestMs = 250;
const kFlightMs = 350;

/**
 * A canvas with one camera, in which maps and other things are drawn; draws only when something changed.
 *
 * Coordinates of objects are those of the map, less `origin` (so that floats do); z up. Public functions take
 * and give map coordinates (doubles). The constructor throws when the browser has no WebGL 2.
 */
export class Scene {
  readonly camera = new THREE.PerspectiveCamera(kFovDeg, 1, 0.1, 1000);
  /** Lines, boxes and signs, drawn after the points, hidden by points in front; coordinates less `origin`. */
  readonly overlay = new THREE.Group();
  /** Height [m, map] of the plane that is met where there is no point. */
  groundHeight: number | undefined;
  private readonly renderer_: THREE.WebGLRenderer;
  private readonly points_ = new THREE.Scene();
  private readonly signs_ = new THREE.Scene();
  private readonly controls_: OrbitControls;
  private readonly pointers_: Pointers;
  private readonly loop_ = new FrameLoop(() => this.draw());
  private readonly eyeDome_ = new EyeDome();
  private readonly clouds_ = new Set<MapCloud>();
  private readonly frameListeners_ = new Set<() => void>();
  private readonly viewListeners_ = new Set<(view: View) => void>();
  private readonly sizeObserver_: ResizeObserver;
  private readonly stop_ = new AbortController();
  private split_: Split | undefined;
  private eyeDomeOn_ = true;
  private quality_: Quality = 'auto';
  private hurried_ = false;
  private moving_ = false;
  private slowFrames_ = 0;
  private lastFrame_ = 0;
  private restTimer_: ReturnType<typeof setTimeout> | undefined;
  private flight_: { from: View; to: View; begin: number } | undefined;

  /** @param origin map coordinates [m] of the scene's zero: a place in or near the maps that will be shown. */
  constructor(
    readonly canvas: HTMLCanvasElement,
    theme: Theme,
    readonly origin: Vec3,
  ) {
    this.renderer_ = new THREE.WebGLRenderer({ canvas, antialias: true, powerPreference: 'high-performance' });
    this.renderer_.autoClear = false;
    this.renderer_.info.autoReset = false;
    this.signs_.add(this.overlay);
    this.camera.up.set(0, 0, 1);
    this.controls_ = new OrbitControls(this.camera, canvas);
    // Never from below the ground.
    this.controls_.maxPolarAngle = 0.495 * Math.PI;
    this.controls_.zoomToCursor = true;
    this.controls_.addEventListener('change', () => this.moved());
    this.pointers_ = new Pointers(this, (on) => (this.controls_.enabled = on));
    const { signal } = this.stop_;
    canvas.addEventListener('keydown', (event) => this.onKey(event), { signal });
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault(), { signal });
    canvas.addEventListener('webglcontextrestored', () => this.requestRender(), { signal });
    this.sizeObserver_ = new ResizeObserver(() => this.resize());
    this.sizeObserver_.observe(canvas);
    this.setTheme(theme);
    this.resize();
  }

  // ---- what is drawn

  addCloud(cloud: MapCloud): void {
    cloud.place(this.origin);
    this.clouds_.add(cloud);
    this.points_.add(cloud.group);
    this.requestRender();
  }

  /** Takes it out; the caller disposes of it. */
  removeCloud(cloud: MapCloud): void {
    this.clouds_.delete(cloud);
    this.points_.remove(cloud.group);
    this.requestRender();
  }

  /** Adds other points (with a material of the caller's) that are shaded like a map; coordinates less `origin`. */
  addPoints(points: THREE.Points): void {
    this.points_.add(points);
    points.updateMatrixWorld(true);
    this.requestRender();
  }

  removePoints(points: THREE.Points): void {
    this.points_.remove(points);
    this.requestRender();
  }

  /** Shows some clouds left and others right of a line, or all of them everywhere. */
  setSplit(split: Split | undefined): void {
    this.split_ = split;
    this.requestRender();
  }

  setTheme(theme: Theme): void {
    this.renderer_.setClearColor(kBackgrounds[theme]);
    this.requestRender();
  }

  setEyeDome(on: boolean): void {
    this.eyeDomeOn_ = on;
    this.requestRender();
  }

  setQuality(quality: Quality): void {
    this.quality_ = quality;
    this.resize();
  }

  /** Draws at the next frame; call it after any change of one's own objects. */
  requestRender(): void {
    this.loop_.request();
  }

  /** @return takes the listener away again. Called after each drawing, to move what lies above the canvas. */
  onFrame(listener: () => void): () => void {
    this.frameListeners_.add(listener);
    return () => this.frameListeners_.delete(listener);
  }

  // ---- where from

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
  onView(listener: (view: View) => void): () => void {
    this.viewListeners_.add(listener);
    return () => this.viewListeners_.delete(listener);
  }

  /** From above at an angle, with all clouds in the picture. */
  showAll(): void {
    this.look(kElevation, kFovDeg);
  }

  /** Straight down; `plan` without perspective. */
  showFromAbove(plan = false): void {
    this.look(kStraightDown, plan ? kPlanFovDeg : kFovDeg);
  }

  /** Brings a place into the middle, seen from a few radii away; glides there unless the person wants less motion. */
  lookAtPlace(place: Vec3, radiusM: number): void {
    const { eye, target } = this.view;
    const away = subtract(eye, target);
    const scale = (2.8 * radiusM) / (Math.tan((this.camera.fov * Math.PI) / 360) * Math.hypot(...away));
    this.flyTo({ target: place, eye: add(place, [away[0] * scale, away[1] * scale, away[2] * scale]) });
  }

  flyTo(view: View): void {
    if (window.matchMedia('(prefers-reduced-motion: reduce)').matches) return this.setView(view);
    this.flight_ = { from: this.view, to: view, begin: performance.now() };
    this.requestRender();
  }

  // ---- pointing

  /** Replaces what the pointer does; null gives it back to the camera. The tool before is cancelled. */
  setTool(tool: Tool | null): void {
    this.pointers_.setTool(tool);
  }

  /** @return takes the listener away again. Called as the pointer moves over the canvas, undefined when it leaves. */
  onHover(listener: (pick: Pick | undefined) => void): () => void {
    return this.pointers_.onHover(listener);
  }

  /** What is at a place of the window [CSS px]; undefined when neither a point nor the ground plane is. */
  pick(clientX: number, clientY: number): Pick | undefined {
    const ray = this.ray(clientX, clientY);
    const tolerance = kPickPx / this.pixelsPerRadian(this.canvas.clientHeight);
    let best: (Pick & { depth: number }) | undefined;
    for (const cloud of this.cloudsAt(clientX)) {
      const point = cloud.pick(ray, tolerance);
      if (point !== undefined && (best === undefined || point.depth < best.depth)) {
        best = { position: point.position, point, cloud, depth: point.depth };
      }
    }
    return best ?? this.onGround(ray);
  }

  /** The ray [m, less `origin`] through a place of the window [CSS px]. */
  ray(clientX: number, clientY: number): Ray {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const at = new THREE.Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
    this.camera.updateMatrixWorld();
    const caster = new THREE.Raycaster();
    caster.setFromCamera(at, this.camera);
    const { origin, direction } = caster.ray;
    return { origin: [origin.x, origin.y, origin.z], direction: [direction.x, direction.y, direction.z] };
  }

  /** Where a place (map coordinates) is in the canvas [CSS px]; null when it is behind the eye. */
  project(place: Vec3): { x: number; y: number } | null {
    const seen = this.toLocal(place).applyMatrix4(this.camera.matrixWorldInverse);
    if (seen.z >= 0) return null;
    seen.applyMatrix4(this.camera.projectionMatrix);
    return { x: ((seen.x + 1) / 2) * this.canvas.clientWidth, y: ((1 - seen.y) / 2) * this.canvas.clientHeight };
  }

  toLocal(place: Vec3): THREE.Vector3 {
    return new THREE.Vector3(...subtract(place, this.origin));
  }

  toMap({ x, y, z }: THREE.Vector3): Vec3 {
    return add([x, y, z], this.origin);
  }

  // ---- the rest

  get costs(): FrameCosts {
    return this.loop_.costs;
  }

  resetCosts(): void {
    this.loop_.resetCosts();
  }

  dispose(): void {
    this.stop_.abort();
    clearTimeout(this.restTimer_);
    this.loop_.dispose();
    this.sizeObserver_.disconnect();
    this.pointers_.dispose();
    this.controls_.dispose();
    this.eyeDome_.dispose();
    this.renderer_.dispose();
  }

  private look(elevation: number, fovDeg: number): void {
    const shape = [...this.clouds_].flatMap((cloud) => cloud.shape.map((corner) => subtract(corner, this.origin)));
    if (shape.length === 0) return;
    this.camera.fov = fovDeg;
    this.camera.updateProjectionMatrix();
    const view = fitView(shape, (fovDeg * Math.PI) / 180, this.camera.aspect, elevation);
    this.camera.position.set(...view.eye);
    this.controls_.target.set(...view.target);
    this.controls_.minDistance = 0.5;
    this.controls_.maxDistance = 4 * this.camera.position.distanceTo(this.controls_.target);
    this.controls_.update();
    this.moved();
  }

  private onKey(event: KeyboardEvent): void {
    const move = steer(event);
    if (move === undefined) return;
    event.preventDefault();
    if (move === 'all') return this.showAll();
    if (move === 'above') return this.showFromAbove();
    move(this.camera, this.controls_.target, this.controls_);
    this.controls_.update();
    this.moved();
  }

  // Less is drawn while the camera moves, once some frames have been slow.
  private moved(): void {
    this.moving_ = true;
    clearTimeout(this.restTimer_);
    this.restTimer_ = setTimeout(() => {
      this.moving_ = false;
      this.slowFrames_ = 0;
      this.hurry(false);
      for (const listener of this.viewListeners_) listener(this.view);
    }, kRestMs);
    this.requestRender();
  }

  private hurry(on: boolean): void {
    if (on === this.hurried_) return;
    this.hurried_ = on;
    this.resize();
  }

  private get reduced(): boolean {
    return this.quality_ === 'reduced' || this.hurried_;
  }

  private draw(): void {
    const now = performance.now();
    if (this.moving_ && this.quality_ === 'auto' && now - this.lastFrame_ > kSlowFrameMs && now - this.lastFrame_ < kRestMs * 4) {
      if (++this.slowFrames_ >= 3) this.hurry(true);
    }
    this.lastFrame_ = now;
    this.fly(now);
    this.setDepths();
    this.camera.updateMatrixWorld();
    const { width, height } = this.canvas;
    for (const cloud of this.clouds_) {
      cloud.update(this.camera, width, height);
      cloud.materials.setPixels(this.pixelsPerRadian(height), this.renderer_.getPixelRatio());
    }
    this.renderer_.info.reset();
    this.renderer_.clear();
    this.drawPoints();
    this.renderer_.render(this.signs_, this.camera);
    for (const listener of this.frameListeners_) listener();
  }

  private drawPoints(): void {
    if (this.split_ === undefined) return this.drawSide(undefined);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const at = Math.round(width * this.split_.share);
    this.renderer_.setScissorTest(true);
    this.renderer_.setScissor(0, 0, at, height);
    this.drawSide(this.split_.left);
    this.renderer_.setScissor(at, 0, width - at, height);
    this.drawSide(this.split_.right);
    this.renderer_.setScissorTest(false);
    for (const cloud of this.clouds_) cloud.group.visible = true;
  }

  private drawSide(shown: readonly MapCloud[] | undefined): void {
    if (shown !== undefined) for (const cloud of this.clouds_) cloud.group.visible = shown.includes(cloud);
    if (this.eyeDomeOn_ && !this.reduced) {
      this.eyeDome_.render(this.renderer_, this.points_, this.camera, 1.3 * this.renderer_.getPixelRatio());
    } else {
      this.renderer_.render(this.points_, this.camera);
    }
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

  // As near and as far as the clouds need, so that the depths in between are told apart.
  private setDepths(): void {
    const eye = this.camera.position;
    let far = 2 * eye.distanceTo(this.controls_.target) + 10;
    for (const { bounds } of this.clouds_) {
      if (bounds === undefined) continue;
      const [low, high] = [this.toLocal(bounds.min), this.toLocal(bounds.max)];
      far = Math.max(far, eye.distanceTo(low.clone().add(high).multiplyScalar(0.5)) + 0.6 * low.distanceTo(high));
    }
    this.camera.near = Math.max(far / 20_000, 0.02 * eye.distanceTo(this.controls_.target), 0.05);
    this.camera.far = far;
    this.camera.updateProjectionMatrix();
  }

  private onGround({ origin, direction }: Ray): Pick | undefined {
    if (this.groundHeight === undefined) return undefined;
    const depth = (this.groundHeight - this.origin[2] - origin[2]) / direction[2];
    if (!(depth > 0 && depth < this.camera.far)) return undefined;
    const along: Vec3 = [direction[0] * depth, direction[1] * depth, direction[2] * depth];
    return { position: add(add(origin, along), this.origin) };
  }

  private cloudsAt(clientX: number): readonly MapCloud[] {
    if (this.split_ === undefined) return [...this.clouds_];
    const { left, width } = this.canvas.getBoundingClientRect();
    return clientX - left < width * this.split_.share ? this.split_.left : this.split_.right;
  }

  private pixelsPerRadian(height: number): number {
    return height / (2 * Math.tan((this.camera.fov * Math.PI) / 360));
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    const ratio = Math.min(window.devicePixelRatio, 2) * (this.reduced ? 0.6 : 1);
    if (this.renderer_.getPixelRatio() !== ratio) this.renderer_.setPixelRatio(ratio);
    this.renderer_.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.requestRender();
  }
}

import * as THREE from 'three';
import { EyeDome } from './eye_dome.js';
import { FrameLoop, type FrameCosts } from './frame_loop.js';
import type { MapCloud } from './map_cloud.js';
import { Pointers, type Tool, type Pick } from './pointers.js';
import type { Ray } from './pick.js';
import { Steering, type Lens, type View } from './steering.js';
import { add, type Theme, type Vec3 } from './types.js';

export type { View } from './steering.js';

/** `auto` draws less while the camera moves, on machines that need it. */
export type Quality = 'auto' | 'full' | 'reduced';

/**
 * Two pictures from one eye; the left one has `share` of the width. They are one view cut at a line, or, if `apart`, the
 * whole view twice.
 */
export interface Split {
  readonly left: readonly MapCloud[];
  readonly right: readonly MapCloud[];
  readonly share: number;
  readonly apart?: boolean;
}

export const kBackgrounds: Record<Theme, number> = { dark: 0x0f1318, light: 0xf4f6f8 };
const kPickPx = 7;
const kSlowFrameMs = 70;
const kSlowFrames = 3;
/** A longer pause between two frames was not caused by drawing. */
const kPauseMs = 1000;

/**
 * A canvas with one camera, which draws maps and other objects, and only after a change.
 *
 * Coordinates of objects are relative to `origin`, so that floats are precise enough; z up. Public functions take and
 * return map coordinates (doubles). The constructor throws if the browser has no WebGL 2.
 */
export class Scene {
  /** Lines and boxes, drawn after the points and hidden by points in front; coordinates relative to `origin`. */
  readonly overlay = new THREE.Group();
  /** Height [m, map] of the plane that is picked where there is no point. */
  groundHeight: number | undefined;
  private readonly renderer_: THREE.WebGLRenderer;
  private readonly points_ = new THREE.Scene();
  private readonly signs_ = new THREE.Scene();
  private readonly steering_: Steering;
  private readonly pointers_: Pointers;
  private readonly loop_ = new FrameLoop(() => this.draw());
  private readonly eyeDome_ = new EyeDome();
  private readonly clouds_ = new Set<MapCloud>();
  private readonly frameListeners_ = new Set<() => void>();
  private readonly sizeObserver_: ResizeObserver;
  private readonly stop_ = new AbortController();
  private split_: Split | undefined;
  private eyeDomeOn_ = true;
  private quality_: Quality = 'auto';
  private hurried_ = false;
  private slowFrames_ = 0;
  private lastFrame_ = 0;

  /** @param origin map coordinates [m] of the scene's origin: a place in or near the maps that will be shown. */
  constructor(
    readonly canvas: HTMLCanvasElement,
    theme: Theme,
    readonly origin: Vec3,
  ) {
    this.renderer_ = new THREE.WebGLRenderer({ canvas, antialias: true, powerPreference: 'high-performance' });
    this.renderer_.autoClear = false;
    this.renderer_.info.autoReset = false;
    this.renderer_.localClippingEnabled = true;
    // Reading the shader compiler's log waits for the compiler: half a second in software rendering.
    this.renderer_.debug.checkShaderErrors = false;
    this.signs_.add(this.overlay);
    this.steering_ = new Steering(canvas, origin, () => [...this.clouds_].flatMap((cloud) => cloud.shape), () => this.moved());
    this.pointers_ = new Pointers(this, (on) => (this.steering_.enabled = on));
    const { signal } = this.stop_;
    canvas.addEventListener('keydown', (event) => this.steering_.onKey(event), { signal });
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

  /** Removes it; the caller disposes of it. */
  removeCloud(cloud: MapCloud): void {
    this.clouds_.delete(cloud);
    this.points_.remove(cloud.group);
    this.requestRender();
  }

  /** Adds other points (with a material of the caller's) that are shaded like a map; coordinates relative to `origin`. */
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
    this.steering_.widthShare = split?.apart ? 0.5 : 1;
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
    if (quality === this.quality_) return;
    this.quality_ = quality;
    this.resize();
  }

  /** Draws at the next frame; to be called after a change of added objects. */
  requestRender(): void {
    this.loop_.request();
  }

  /** @return removes the listener. Called after each drawing, to move labels above the canvas. */
  onFrame(listener: () => void): () => void {
    this.frameListeners_.add(listener);
    return () => this.frameListeners_.delete(listener);
  }

  // ---- where from

  get view(): View {
    return this.steering_.view;
  }

  setView(view: View): void {
    this.steering_.setView(view);
  }

  /** @return removes the listener. Called when the camera has come to rest. */
  onView(listener: (view: View) => void): () => void {
    return this.steering_.onRest(listener);
  }

  /** From above at an angle, with all clouds in the picture. */
  showAll(): void {
    this.steering_.showAll('aslant');
  }

  /** Straight down, by parallel rays, as a plan. */
  showFromAbove(): void {
    this.steering_.showAll('above');
  }

  /** Moves the camera to a few radii from a place; animated unless the person prefers less motion. */
  lookAtPlace(place: Vec3, radiusM: number): void {
    this.steering_.lookAt(place, radiusM);
  }

  flyTo(view: View): void {
    this.steering_.flyTo(view);
  }

  // ---- pointing

  /** Sets the tool of the pointer, and cancels the one before; null = the pointer moves the camera. */
  setTool(tool: Tool | null): void {
    this.pointers_.setTool(tool);
  }

  /** @return removes the listener. Called as the pointer moves over the canvas, undefined when it leaves. */
  onHover(listener: (pick: Pick | undefined) => void): () => void {
    return this.pointers_.onHover(listener);
  }

  /** The point or ground at a place of the window [CSS px]; undefined if there is neither. */
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

  /** The ray [m, relative to `origin`] through a place of the window [CSS px]. */
  ray(clientX: number, clientY: number): Ray {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const x = clientX - left - this.shiftAt(clientX);
    const at = new THREE.Vector2((2 * x) / width - 1, 1 - (2 * (clientY - top)) / height);
    const caster = new THREE.Raycaster();
    caster.setFromCamera(at, this.lens);
    const { origin, direction } = caster.ray;
    return { origin: [origin.x, origin.y, origin.z], direction: [direction.x, direction.y, direction.z] };
  }

  /** Where a place (map coordinates) is in the canvas [CSS px]; null if it is behind the eye. */
  project(place: Vec3): { x: number; y: number } | null {
    const seen = this.toLocal(place).applyMatrix4(this.lens.matrixWorldInverse);
    if (seen.z >= 0) return null;
    seen.applyMatrix4(this.lens.projectionMatrix);
    return { x: ((seen.x + 1) / 2) * this.canvas.clientWidth, y: ((1 - seen.y) / 2) * this.canvas.clientHeight };
  }

  toLocal(place: Vec3): THREE.Vector3 {
    return this.steering_.toLocal(place);
  }

  // ---- the rest

  get costs(): FrameCosts {
    return this.loop_.costs;
  }

  dispose(): void {
    this.stop_.abort();
    this.loop_.dispose();
    this.sizeObserver_.disconnect();
    this.pointers_.dispose();
    this.steering_.dispose();
    this.eyeDome_.dispose();
    this.renderer_.dispose();
  }

  private moved(): void {
    if (!this.steering_.moving) {
      this.slowFrames_ = 0;
      this.hurried_ = false;
    }
    this.requestRender();
  }

  // After some slow frames, less is drawn while the camera moves.
  private watchPace(now: number): void {
    const took = now - this.lastFrame_;
    this.lastFrame_ = now;
    if (!this.steering_.moving || this.quality_ !== 'auto' || took < kSlowFrameMs || took > kPauseMs) return;
    if (++this.slowFrames_ >= kSlowFrames) this.hurried_ = true;
  }

  private draw(): void {
    const now = performance.now();
    this.watchPace(now);
    this.steering_.prepare(now, [...this.clouds_].flatMap((cloud) => cloud.bounds ?? []));
    const { width, height } = this.canvas;
    for (const cloud of this.clouds_) {
      cloud.update(this.lens, width, height);
      cloud.materials.setPixels(this.pixelsPerRadian(height), this.renderer_.getPixelRatio());
    }
    this.renderer_.info.reset();
    this.renderer_.clear();
    this.drawSides();
    for (const listener of this.frameListeners_) listener();
  }

  private get lens(): Lens {
    return this.steering_.lens;
  }

  private drawSides(): void {
    if (this.split_ === undefined) {
      this.drawSide(undefined);
      return this.renderer_.render(this.signs_, this.lens);
    }
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const { left, right, apart } = this.split_;
    const at = this.splitAt(width);
    this.renderer_.setScissorTest(true);
    for (const [shown, from, to, shift] of [[left, 0, at, -width / 4], [right, at, width, width / 4]] as const) {
      if (apart) this.lens.setViewOffset(width, height, -shift, 0, width, height);
      this.renderer_.setScissor(from, 0, to - from, height);
      this.drawSide(shown);
      this.renderer_.render(this.signs_, this.lens);
    }
    this.lens.clearViewOffset();
    this.renderer_.setScissorTest(false);
    for (const cloud of this.clouds_) cloud.group.visible = true;
  }

  /** Where the sides meet [CSS px]. */
  private splitAt(width: number): number {
    return Math.round(width * (this.split_?.apart ? 0.5 : this.split_?.share ?? 1));
  }

  /** By how much the picture at a place of the window is moved to the right [CSS px], when the halves are apart. */
  private shiftAt(clientX: number): number {
    if (!this.split_?.apart) return 0;
    const { left, width } = this.canvas.getBoundingClientRect();
    return clientX - left < width / 2 ? -width / 4 : width / 4;
  }

  private drawSide(shown: readonly MapCloud[] | undefined): void {
    if (shown !== undefined) for (const cloud of this.clouds_) cloud.group.visible = shown.includes(cloud);
    if (this.eyeDomeOn_ && this.quality_ !== 'reduced' && !this.hurried_) {
      this.eyeDome_.render(this.renderer_, this.points_, this.lens, 1.3 * this.renderer_.getPixelRatio());
    } else {
      this.renderer_.render(this.points_, this.lens);
    }
  }

  private onGround({ origin, direction }: Ray): Pick | undefined {
    if (this.groundHeight === undefined) return undefined;
    const depth = (this.groundHeight - this.origin[2] - origin[2]) / direction[2];
    if (!(depth > 0 && depth < this.lens.far)) return undefined;
    const along: Vec3 = [direction[0] * depth, direction[1] * depth, direction[2] * depth];
    return { position: add(add(origin, along), this.origin) };
  }

  private cloudsAt(clientX: number): readonly MapCloud[] {
    if (this.split_ === undefined) return [...this.clouds_];
    const { left, width } = this.canvas.getBoundingClientRect();
    return clientX - left < this.splitAt(width) ? this.split_.left : this.split_.right;
  }

  private pixelsPerRadian(height: number): number {
    return height / (2 * Math.tan(this.steering_.halfFov));
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    const ratio = Math.min(window.devicePixelRatio, 2) * (this.quality_ === 'reduced' ? 0.6 : 1);
    this.steering_.aspect = width / height;
    // Setting the canvas size waits for all earlier drawing, even if the size is the same.
    const [wide, high] = [Math.floor(width * ratio), Math.floor(height * ratio)];
    if (this.canvas.width === wide && this.canvas.height === high) return this.requestRender();
    this.renderer_.setPixelRatio(ratio);
    this.renderer_.setSize(width, height, false);
    // The canvas is empty now, so it is drawn before the browser shows it.
    this.loop_.now();
  }
}

import * as THREE from 'three';
import type { Rgb } from '../scene/colour_maps.js';
import { PaintedPoints } from '../scene/painted_points.js';
import { between, easeOut, quaternionOf, type Pose, type Vec3 } from './pose.js';
import { kMaxResidual_m, type MapPoints } from './residual.js';

const kPoint = { sizeM: 0.06, pixels: [2, 6], towardsEyeM: 0.05 } as const;
/** Time per frame for computing residuals [ms]. */
const kSlice_ms = 3;
const kPointsAtOnce = 500;
const kSnap_ms = 900;
const kRampSteps = 64;

/** Colours of a scan by its distance to the map: near, between, far. */
export interface ResidualColours {
  near: Rgb;
  middle: Rgb;
  far: Rgb;
}

/** A scan's points in the picture, at one pose. */
export class ScanCloud {
  private readonly points: PaintedPoints;
  private pose: Pose | undefined;
  private turn = 0;

  /**
   * @param positions lidar frame [m], x y z one after the other; not copied.
   * @param origin    of the picture in the map frame [m].
   * @param redraw    asks for a frame.
   */
  constructor(private readonly positions: Float32Array, private readonly origin: Vec3, private readonly redraw: () => void) {
    this.points = new PaintedPoints({ positions, ...kPoint });
    this.object.visible = false;
    this.object.name = 'scan';
  }

  get object(): THREE.Points {
    return this.points.object;
  }

  /** Moves it there without animation; null hides it. */
  place(pose: Pose | null): void {
    this.turn += 1;
    this.object.visible = pose !== null;
    if (pose !== null) this.stand(pose);
    this.redraw();
  }

  /** Moves it from one pose to another with an animation. Resolves when it has arrived or was moved elsewhere. */
  async snap(from: Pose, to: Pose, still: boolean): Promise<void> {
    this.place(still ? to : from);
    if (still) return;
    const turn = this.turn;
    const begin = performance.now();
    for (let share = 0; share < 1;) {
      const now = await nextFrame();
      if (turn !== this.turn) return;
      share = Math.min(1, Math.max(0, now - begin) / kSnap_ms);
      this.stand(between(from, to, easeOut(share)));
      this.redraw();
    }
  }

  paint(colour: Rgb): void {
    this.points.paint(() => colour);
    this.shown();
  }

  /** Colours each point by its distance to the map at the present pose, some points per frame. */
  async paintByResidual(map: MapPoints, colours: ResidualColours, signal: AbortSignal): Promise<void> {
    if (this.pose === undefined) return;
    const turn = this.turn;
    const matrix = matrixAt(this.pose, this.origin);
    const ramp = rampOf(colours);
    const at = new THREE.Vector3();
    const colourOf = (i: number): Rgb => {
      at.fromArray(this.positions, 3 * i).applyMatrix4(matrix);
      const share = map.residual(at.x, at.y, at.z) / kMaxResidual_m;
      return ramp[Math.round(share * (kRampSteps - 1))]!;
    };
    let begin = performance.now();
    for (let i = 0; i < this.points.count; i += kPointsAtOnce) {
      this.points.paint(colourOf, i, Math.min(this.points.count, i + kPointsAtOnce));
      if (performance.now() - begin < kSlice_ms) continue;
      await nextFrame();
      if (signal.aborted || turn !== this.turn) return;
      begin = performance.now();
    }
    this.shown();
  }

  dispose(): void {
    this.turn += 1;
    this.points.dispose();
  }

  private stand(pose: Pose): void {
    this.pose = pose;
    matrixAt(pose, this.origin).decompose(this.object.position, this.object.quaternion, this.object.scale);
    this.object.updateMatrixWorld();
  }

  private shown(): void {
    this.points.shown();
    this.redraw();
  }
}

/** From the lidar frame to the picture. */
export function matrixAt(pose: Pose, origin: Vec3): THREE.Matrix4 {
  const [x, y, z] = pose.position.map((value, axis) => value - origin[axis]!) as Vec3;
  return new THREE.Matrix4().compose(new THREE.Vector3(x, y, z), quaternionOf(pose), new THREE.Vector3(1, 1, 1));
}

function rampOf({ near, middle, far }: ResidualColours): Rgb[] {
  const mix = (a: Rgb, b: Rgb, share: number): Rgb => [0, 1, 2].map((i) => a[i]! + (b[i]! - a[i]!) * share) as unknown as Rgb;
  return Array.from({ length: kRampSteps }, (_, i) => {
    const share = (2 * i) / (kRampSteps - 1);
    return share < 1 ? mix(near, middle, share) : mix(middle, far, share - 1);
  });
}

function nextFrame(): Promise<number> {
  return new Promise((resolve) => requestAnimationFrame(resolve));
}

/** A ray: origin and direction of length 1; [m] in the frame of the points. */
export interface Ray {
  readonly origin: readonly [number, number, number];
  readonly direction: readonly [number, number, number];
}

/** Distance of a place along a ray [m]; both in one frame. */
export function depthAlong({ origin, direction }: Ray, [x, y, z]: readonly [number, number, number]): number {
  return (x - origin[0]) * direction[0] + (y - origin[1]) * direction[1] + (z - origin[2]) * direction[2];
}

/** A point near a ray. */
export interface Hit {
  /** Index of the point. */
  readonly index: number;
  /** Distance along the ray [m], and distance from it as a share of the tolerance. */
  readonly depth: number;
  readonly beside: number;
}

/** Number of points that share one bounding box. */
const kRun = 256;
/** Points this much [m] behind the first one seen still count as the same surface. */
const kSurfaceM = 0.5;

/** Points of a tile with the bounds of each group, so that most groups need not be tested. */
export class PickPoints {
  private readonly bounds_: Float32Array;

  /**
   * @param values  coordinates, x y z of point i at i * stride; not copied.
   * @param stride  numbers from one point to the next, at least 3.
   */
  constructor(
    private readonly values_: Float32Array,
    private readonly stride_: number,
    readonly count: number,
  ) {
    this.bounds_ = boundsOfRuns(values_, stride_, count);
  }

  /**
   * The point at a ray: of the points within the tolerance those that are first along the ray, and of these the one
   * nearest to the ray.
   *
   * @param tolerance half opening angle of the cone around the ray, as a slope.
   * @param holds     points that count.
   * @param limit     most points to test; `looked` of the result is the number tested.
   */
  nearest(ray: Ray, tolerance: number, holds: (index: number) => boolean, limit: number): { hit?: Hit; looked: number } {
    const near: Hit[] = [];
    let first = Infinity;
    let looked = 0;
    for (let run = 0; run * kRun < this.count && looked < limit; ++run) {
      if (!this.meets(run, ray, tolerance, first)) continue;
      const end = Math.min((run + 1) * kRun, this.count);
      looked += end - run * kRun;
      for (let index = run * kRun; index < end; ++index) {
        const hit = this.test(index, ray, tolerance);
        if (hit === undefined || hit.depth > first + kSurfaceM || !holds(index)) continue;
        near.push(hit);
        first = Math.min(first, hit.depth);
      }
    }
    const hit = near.filter(({ depth }) => depth <= first + kSurfaceM)
      .reduce<Hit | undefined>((best, one) => (best === undefined || one.beside < best.beside ? one : best), undefined);
    return hit === undefined ? { looked } : { hit, looked };
  }

  private test(index: number, { origin, direction }: Ray, tolerance: number): Hit | undefined {
    const at = index * this.stride_;
    const x = (this.values_[at] as number) - origin[0];
    const y = (this.values_[at + 1] as number) - origin[1];
    const z = (this.values_[at + 2] as number) - origin[2];
    const depth = x * direction[0] + y * direction[1] + z * direction[2];
    if (!(depth > 0)) return undefined;
    const beside2 = x * x + y * y + z * z - depth * depth;
    const width = tolerance * depth;
    if (beside2 > width * width) return undefined;
    return { index, depth, beside: Math.sqrt(Math.max(beside2, 0)) / width };
  }

  // The run's bounds, widened by the cone where they end, against the ray and what is known to be in front.
  private meets(run: number, { origin, direction }: Ray, tolerance: number, first: number): boolean {
    const at = 6 * run;
    const bounds = this.bounds_;
    let reach = 0;
    for (let axis = 0; axis < 3; ++axis) {
      const [low, high] = [bounds[at + axis] as number, bounds[at + 3 + axis] as number];
      const from = origin[axis] as number;
      reach += Math.max(Math.abs(low - from), Math.abs(high - from)) ** 2;
    }
    const wide = tolerance * Math.sqrt(reach);
    let [enter, leave] = [0, first + kSurfaceM + wide];
    for (let axis = 0; axis < 3; ++axis) {
      const from = origin[axis] as number;
      const slope = direction[axis] as number;
      const [low, high] = [(bounds[at + axis] as number) - wide - from, (bounds[at + 3 + axis] as number) + wide - from];
      if (slope === 0) {
        if (low > 0 || high < 0) return false;
        continue;
      }
      enter = Math.max(enter, Math.min(low / slope, high / slope));
      leave = Math.min(leave, Math.max(low / slope, high / slope));
    }
    return enter <= leave;
  }
}

// Lowest and highest coordinates of each run.
function boundsOfRuns(values: Float32Array, stride: number, count: number): Float32Array {
  const runs = Math.ceil(count / kRun);
  const bounds = new Float32Array(6 * runs);
  for (let run = 0; run < runs; ++run) {
    for (let axis = 0; axis < 3; ++axis) {
      let [low, high] = [Infinity, -Infinity];
      for (let i = run * kRun; i < Math.min((run + 1) * kRun, count); ++i) {
        const value = values[i * stride + axis] as number;
        if (value < low) low = value;
        if (value > high) high = value;
      }
      bounds[6 * run + axis] = low;
      bounds[6 * run + 3 + axis] = high;
    }
  }
  return bounds;
}

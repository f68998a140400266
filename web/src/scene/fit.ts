type Vec3 = readonly [number, number, number];

/** Where to look from: the point looked at, and the eye; metres relative to the map's origin. */
export interface ViewPoint {
  readonly target: Vec3;
  readonly eye: Vec3;
}

/**
 * The view from above at `elevation` [rad] that shows all `corners` and fills the picture best.
 *
 * Tries directions around the compass and keeps the one with the nearest eye, so that a long street fills a wide
 * window. Of equally good directions it prefers the one with north most upward.
 * @param corners at least one.
 * @param fovY    vertical opening angle of the camera [rad].
 * @param aspect  width by height of the picture.
 */
export function fitView(corners: readonly Vec3[], fovY: number, aspect: number, elevation: number): ViewPoint {
  const margin = 1.04;
  const [tanY, tanX] = [Math.tan(fovY / 2) / margin, (Math.tan(fovY / 2) * aspect) / margin];
  let best: { distance: number; view: ViewPoint } | undefined;
  const steps = 24;
  for (let step = 0; step < steps; ++step) {
    // Alternating sides of south (-90 degrees), from which north is up.
    const turn = (step % 2 === 0 ? step / 2 : -(step + 1) / 2) * ((2 * Math.PI) / steps);
    const candidate = fitFrom(corners, -Math.PI / 2 + turn, elevation, tanX, tanY);
    if (best === undefined || candidate.distance < 0.97 * best.distance) best = candidate;
  }
  if (best === undefined) throw new RangeError('corners: none, expected at least one');
  return best.view;
}

// Two planes bound the picture on each axis; the nearest eye that has all corners between them is found on
// its own for x and y, and the farther one is taken.
function fitFrom(corners: readonly Vec3[], azimuth: number, elevation: number, tanX: number, tanY: number) {
  const [ce, se, ca, sa] = [Math.cos(elevation), Math.sin(elevation), Math.cos(azimuth), Math.sin(azimuth)];
  const back: Vec3 = [ce * ca, ce * sa, se];
  const right: Vec3 = [-sa, ca, 0];
  const up: Vec3 = [-se * ca, -se * sa, ce];
  const x = nearestEye(corners.map((c) => [dot(c, right), dot(c, back)] as const), tanX);
  const y = nearestEye(corners.map((c) => [dot(c, up), dot(c, back)] as const), tanY);
  const depth = Math.max(x.depth, y.depth);
  const along = (d: number): Vec3 => [0, 1, 2].map((i) =>
    (right[i] as number) * x.across + (up[i] as number) * y.across + (back[i] as number) * d) as unknown as Vec3;
  // Turning and zooming go about the target: the middle of the depths seen.
  const depths = corners.map((c) => dot(c, back));
  const middle = (depths.reduce((a, b) => Math.min(a, b)) + depths.reduce((a, b) => Math.max(a, b))) / 2;
  return { distance: depth - middle, view: { target: along(middle), eye: along(depth) } };
}

// |across_i - across| <= tan * (depth - depth_i) for all i; the smallest such depth.
function nearestEye(points: readonly (readonly [number, number])[], tan: number) {
  let [high, low] = [-Infinity, -Infinity];
  for (const [across, depth] of points) {
    high = Math.max(high, across + tan * depth);
    low = Math.max(low, -across + tan * depth);
  }
  return { across: (high - low) / 2, depth: (high + low) / (2 * tan) };
}

function dot(a: Vec3, b: Vec3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

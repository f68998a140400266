/** Red, green, blue in 0..255 (sRGB). */
export type Rgb = readonly [number, number, number];
export type Theme = 'dark' | 'light';

// One order of hues in both themes, low = blue to high = yellow or red; each theme keeps every stop at a
// distance from its background that a single pixel can be seen at.
const kStops: Record<Theme, readonly Rgb[]> = {
  dark: [
    [72, 100, 214], [40, 148, 222], [28, 184, 190], [66, 206, 138], [150, 218, 88], [226, 214, 74], [252, 166, 76],
    [250, 108, 92],
  ],
  light: [
    [44, 62, 150], [24, 98, 172], [8, 124, 142], [16, 134, 96], [84, 138, 32], [158, 128, 0], [192, 92, 10],
    [178, 40, 48],
  ],
};

/** Colour at `share` (0 = lowest, 1 = highest; clamped) of the height range. */
export function heightColour(share: number, theme: Theme): Rgb {
  const stops = kStops[theme];
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const index = Math.min(Math.floor(at), stops.length - 2);
  const [low, high] = [stops[index] as Rgb, stops[index + 1] as Rgb];
  const mix = (axis: 0 | 1 | 2): number => Math.round(low[axis] + (high[axis] - low[axis]) * (at - index));
  return [mix(0), mix(1), mix(2)];
}

/** `steps` colours from lowest to highest, RGBA bytes, for the lookup texture of the points and the legend. */
export function heightRamp(steps: number, theme: Theme): Uint8Array {
  const ramp = new Uint8Array(4 * steps);
  for (let i = 0; i < steps; ++i) ramp.set([...heightColour(i / (steps - 1), theme), 255], 4 * i);
  return ramp;
}

/** How many points had which height, in cells of 0.1 m; grows with every tile. */
export class HeightHistogram {
  private readonly cells_ = new Map<number, number>();
  private total_ = 0;

  /** @param points x, y, z [m] one after the other. */
  add(points: Float32Array): void {
    for (let i = 2; i < points.length; i += 3) {
      const cell = Math.floor((points[i] as number) * 10);
      this.cells_.set(cell, (this.cells_.get(cell) ?? 0) + 1);
      ++this.total_;
    }
  }

  /**
   * Heights [m] that 2 % of the points lie below and 2 % above: a few birds or reflections would otherwise
   * squeeze all else into one colour. At least 1 m apart; undefined while there are no points.
   */
  range(): { low: number; high: number } | undefined {
    if (this.total_ === 0) return undefined;
    const cells = [...this.cells_].sort((a, b) => a[0] - b[0]);
    const low = quantile(cells, 0.02 * this.total_) / 10;
    const high = (quantile(cells, 0.98 * this.total_) + 1) / 10;
    return { low, high: Math.max(high, low + 1) };
  }
}

function quantile(cells: readonly (readonly [number, number])[], rank: number): number {
  let below = 0;
  for (const [cell, count] of cells) {
    below += count;
    if (below >= rank) return cell;
  }
  return (cells[cells.length - 1] as readonly [number, number])[0];
}

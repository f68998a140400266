import type { Range } from './types.js';

/** A histogram of values with cells of one width; it grows with every tile. */
export class Histogram {
  private readonly cells_ = new Map<number, number>();
  private total_ = 0;

  /** @param width of a cell, > 0. */
  constructor(private readonly width_: number) {
    if (!(width_ > 0)) throw new RangeError(`width: ${width_}, must be above 0`);
  }

  add(value: number): void {
    const cell = Math.floor(value / this.width_);
    this.cells_.set(cell, (this.cells_.get(cell) ?? 0) + 1);
    ++this.total_;
  }

  /**
   * The range without the lowest and the highest `share` of the values: a few birds or reflections would otherwise
   * squeeze all others into one colour. At least `least` wide; undefined while there are no values.
   */
  range(share: number, least: number): Range | undefined {
    if (this.total_ === 0) return undefined;
    const cells = [...this.cells_].sort((a, b) => a[0] - b[0]);
    const low = quantile(cells, share * this.total_) * this.width_;
    const high = (quantile(cells, (1 - share) * this.total_) + 1) * this.width_;
    return { low, high: Math.max(high, low + least) };
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

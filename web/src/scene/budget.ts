/** A tile of a tree in which children replace their parent. */
export interface BudgetTile {
  readonly children?: readonly BudgetTile[];
  /** Points of this tile; 0 if it only groups others. */
  readonly points: number;
}

/**
 * The screen-space error [px] for a renderer, so that it draws at most a number of points.
 *
 * Refines the tile with the largest error first, as a renderer does that refines every tile whose error is above
 * the result, and stops before the budget is exceeded. Deterministic; visits only tiles that it refines.
 * @param root     of the tree.
 * @param errorOf  error [px] of a tile as seen, Infinity where the eye is inside, or undefined when it is
 *                 out of the picture (such a tile is not drawn and not refined).
 * @param budget   points, > 0. The coarsest level is drawn even if it has more.
 * @param finestPx error below which no tile is refined, > 0: more points than pixels are of no use.
 */
export function errorForBudget<Tile extends BudgetTile>(
  root: Tile, errorOf: (tile: Tile) => number | undefined, budget: number, finestPx: number,
): number {
  if (!(budget > 0)) throw new RangeError(`budget: ${budget}, must be above 0`);
  const open = new Heap<Tile>();
  const put = (tile: Tile): number => {
    const error = errorOf(tile);
    if (error === undefined) return 0;
    open.push(tile, error);
    return tile.points;
  };
  let drawn = put(root);
  for (let top = open.pop(); top !== undefined; top = open.pop()) {
    if (top.error <= finestPx) return finestPx;
    const children = (top.item.children ?? []) as readonly Tile[];
    if (children.length === 0) continue;
    drawn += children.reduce((sum, child) => sum + put(child), 0) - top.item.points;
    // Every refined tile has a larger error than this one.
    if (drawn > budget && top.item.points > 0) return Math.max(top.error, finestPx);
  }
  return finestPx;
}

/** Largest error first. */
class Heap<Item> {
  private readonly entries_: { item: Item; error: number }[] = [];

  push(item: Item, error: number): void {
    const entries = this.entries_;
    let at = entries.length;
    entries.push({ item, error });
    while (at > 0) {
      const above = (at - 1) >> 1;
      if (this.error(above) >= error) break;
      this.swap(at, above);
      at = above;
    }
  }

  pop(): { item: Item; error: number } | undefined {
    const entries = this.entries_;
    const top = entries[0];
    const last = entries.pop();
    if (top === undefined || last === undefined || entries.length === 0) return top;
    entries[0] = last;
    for (let at = 0; ;) {
      const [left, right] = [2 * at + 1, 2 * at + 2];
      let largest = at;
      if (left < entries.length && this.error(left) > this.error(largest)) largest = left;
      if (right < entries.length && this.error(right) > this.error(largest)) largest = right;
      if (largest === at) return top;
      this.swap(at, largest);
      at = largest;
    }
  }

  private error(at: number): number {
    return (this.entries_[at] as { error: number }).error;
  }

  private swap(a: number, b: number): void {
    const entries = this.entries_ as [{ item: Item; error: number }];
    [entries[a], entries[b]] = [entries[b] as { item: Item; error: number }, entries[a] as { item: Item; error: number }];
  }
}

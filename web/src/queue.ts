/**
 * Runs `work` on every item, in order, with at most `limit` under way at once.
 *
 * A failure of one item does not stop the others; `work` is expected to record it. After an abort nothing
 * new is started, and the promise resolves when what was under way has ended.
 */
export async function forEachBounded<Item>(
  items: readonly Item[],
  limit: number,
  signal: AbortSignal,
  work: (item: Item) => Promise<void>,
): Promise<void> {
  if (!(limit >= 1)) throw new RangeError(`limit: ${limit}, must be at least 1`);
  let next = 0;
  const lane = async (): Promise<void> => {
    while (next < items.length && !signal.aborted) {
      const item = items[next++] as Item;
      await work(item);
    }
  };
  await Promise.all(Array.from({ length: Math.min(limit, items.length) }, lane));
}

/** What the order of tiles needs to know of them; metres relative to the map's origin. */
export interface Extent {
  readonly min: readonly [number, number, number];
  readonly max: readonly [number, number, number];
}

/** The tiles by horizontal distance of their middle from the middle of all, nearest first. */
export function nearestFirst<Tile extends Extent>(tiles: readonly Tile[]): Tile[] {
  const middle = (axis: 0 | 1): number => {
    const low = Math.min(...tiles.map((tile) => tile.min[axis]));
    const high = Math.max(...tiles.map((tile) => tile.max[axis]));
    return (low + high) / 2;
  };
  const [x, y] = [middle(0), middle(1)];
  const distance = (tile: Tile): number =>
    Math.hypot((tile.min[0] + tile.max[0]) / 2 - x, (tile.min[1] + tile.max[1]) / 2 - y);
  return [...tiles].sort((a, b) => distance(a) - distance(b));
}

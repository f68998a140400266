import { ask, type Schema } from './client.js';

/** A tile of a version; bounds [m] relative to the map's origin. */
export type ListedTile = Schema<'TileList'>['tiles'][number];

/** x, y from and to [m], relative to the map's origin. */
export interface Area {
  readonly min: readonly [number, number];
  readonly max: readonly [number, number];
}

const kAtOnce = 1000;

/**
 * Tiles of a version that touch an area; all without one.
 *
 * @param mostPoints no more tiles are listed once they have more points together.
 * @throws ApiError; AbortError when `signal` fires.
 */
export async function listTiles(
  place: { map: string; version: string }, area: Area | undefined, signal: AbortSignal, mostPoints = Infinity,
): Promise<ListedTile[]> {
  const found: ListedTile[] = [];
  const wanted = area && [...area.min, ...area.max].map((value) => value.toFixed(3)).join(',');
  let points = 0;
  for (let before: number | undefined; ;) {
    const { data } = await ask('get', '/v1/maps/{map}/versions/{version}/tiles', {
      path: { ...place }, query: { limit: kAtOnce, ...(before !== undefined && { before }), ...(wanted !== undefined && { area: wanted }) }, signal,
    });
    found.push(...data.tiles);
    points += data.tiles.reduce((sum, tile) => sum + tile.points, 0);
    if (data.next === null || points > mostPoints) return found;
    before = data.next;
  }
}

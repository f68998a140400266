import { ApiError, type Api, type MapDetails, type TileEntry } from './api.js';
import { boxEdges } from './boxes.js';
import { HeightHistogram } from './colour.js';
import type { Panel } from './panel.js';
import { forEachBounded, nearestFirst } from './queue.js';
import { decodeTile, kLayers, type Layer } from './tile.js';
import type { Viewer } from './viewer.js';

const kTilesAtOnce = 4;
const kFailuresNamed = 3;

/**
 * Fetches one map and shows it, tile by tile from its middle outward.
 *
 * @return what could not be shown, in words; empty when all is there.
 * @throws ApiError when the map itself cannot be had, AbortError when `signal` fires.
 */
export async function loadMap(
  api: Api, name: string, viewer: Viewer, panel: Panel, signal: AbortSignal,
): Promise<string> {
  const map = await api.map(name, signal);
  const tiles = nearestFirst(finestTiles(map.tiles));
  panel.setFacts(map);
  viewer.begin(tiles.flatMap(cornersOf), map.voxel_size_m);
  const [, failures] = await Promise.all([
    loadTrack(api, map, viewer, signal),
    loadTiles(api, map, tiles, viewer, panel, signal),
  ]);
  signal.throwIfAborted();
  return failures;
}

// A map may hold coarser levels of the same points.
function finestTiles(tiles: readonly TileEntry[]): TileEntry[] {
  const finest = tiles.reduce((level, tile) => Math.min(level, tile.level), Infinity);
  return tiles.filter((tile) => tile.level === finest);
}

function cornersOf({ min, max }: TileEntry): [number, number, number][] {
  return [min, max].flatMap((a) => [min, max].flatMap((b) => [min, max].map(
    (c): [number, number, number] => [a[0], b[1], c[2]],
  )));
}

async function loadTrack(api: Api, map: MapDetails, viewer: Viewer, signal: AbortSignal): Promise<void> {
  const [poses, objects] = await Promise.all([api.trajectory(map, signal), api.objects(map, signal)]);
  const [x, y, z] = map.origin;
  viewer.setTrajectory(new Float32Array(
    poses.flatMap(({ position }) => [position[0] - x, position[1] - y, position[2] - z]),
  ));
  viewer.setObjects(boxEdges(objects, map.origin));
}

async function loadTiles(
  api: Api, map: MapDetails, tiles: readonly TileEntry[], viewer: Viewer, panel: Panel, signal: AbortSignal,
): Promise<string> {
  const counts: Record<Layer, number> = { measured: 0, ground: 0, projected: 0 };
  const heights = new HeightHistogram();
  const failures: string[] = [];
  const unreachable = new AbortController();
  let done = 0;
  panel.setProgress(0, tiles.length);
  await forEachBounded(tiles, kTilesAtOnce, AbortSignal.any([signal, unreachable.signal]), async (tile) => {
    try {
      const points = decodeTile(await api.tile(map, tile, signal), tile.points);
      viewer.addTile(points);
      for (const layer of kLayers) counts[layer] += points[layer].length / 3;
      heights.add(points.measured);
      heights.add(points.ground);
      ++done;
    } catch (error) {
      if (signal.aborted) return;
      failures.push(`Tile ${tile.level}/${tile.x}/${tile.y}: ${(error as Error).message}`);
      if (error instanceof ApiError && !error.answered) unreachable.abort();
      return;
    }
    panel.setProgress(done, tiles.length);
    panel.setPoints(counts);
    const range = heights.range();
    if (range === undefined) return;
    viewer.setHeightRange(range.low, range.high);
    panel.setHeights({ low: range.low + map.origin[2], high: range.high + map.origin[2] });
  });
  return failures.length === 0 ? '' : inWords(failures, done, tiles.length);
}

function inWords(failures: readonly string[], done: number, total: number): string {
  const named = failures.slice(0, kFailuresNamed);
  if (failures.length > named.length) named.push(`… and ${failures.length - named.length} more`);
  return [`${total - done} of ${total} tiles could not be loaded; the rest is shown.`, ...named].join('\n');
}

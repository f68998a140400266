import type { Box } from './boxes.js';

type Vec3 = [number, number, number];

export interface MapSummary {
  name: string;
  version: string;
  points: number;
  tiles: number;
}

export interface MapList {
  maps: MapSummary[];
  /** Maps in the store that the server could not load, with the reason in words. */
  refused: { name: string; reason: string }[];
}

/** `min` and `max` are relative to the map's `origin` [m], as the points of the tile are. */
export interface TileEntry {
  level: number;
  x: number;
  y: number;
  points: number;
  min: Vec3;
  max: Vec3;
}

export interface MapDetails {
  name: string;
  version: string;
  digest: string;
  frame_id: string;
  /** Added to tile coordinates to get map coordinates [m]. */
  origin: Vec3;
  voxel_size_m: number;
  tiles: TileEntry[];
  objects: number;
  poses: number;
}

/** In map coordinates [m]. */
export interface Pose {
  position: Vec3;
}

/** A request that brought no usable answer; the message says why in words. */
export class ApiError extends Error {
  constructor(
    message: string,
    /** False when no answer came at all, so that asking for more is pointless. */
    readonly answered: boolean,
  ) {
    super(message);
    this.name = 'ApiError';
  }
}

/** The routes of one map version. Every method throws ApiError, or AbortError when `signal` fires. */
export interface Api {
  maps(signal: AbortSignal): Promise<MapList>;
  map(name: string, signal: AbortSignal): Promise<MapDetails>;
  trajectory(map: MapDetails, signal: AbortSignal): Promise<Pose[]>;
  objects(map: MapDetails, signal: AbortSignal): Promise<Box[]>;
  tile(map: MapDetails, tile: TileEntry, signal: AbortSignal): Promise<ArrayBuffer>;
}

const kJsonTimeoutS = 30;
// A tile may be megabytes on a slow line.
const kTileTimeoutS = 120;

/** @param get `fetch`, or what stands in for it in a test. */
export function createApi(get: typeof fetch): Api {
  const json = async <Answer>(path: string, list: keyof Answer, signal: AbortSignal): Promise<Answer> => {
    const response = await request(get, path, kJsonTimeoutS, signal);
    const answer = (await body(path, () => response.json(), signal)) as Answer | null;
    if (!Array.isArray(answer?.[list])) {
      throw new ApiError(`The answer to ${path} has no list "${String(list)}".`, true);
    }
    return answer;
  };
  const versioned = (map: MapDetails): string =>
    `${mapPath(map.name)}/versions/${encodeURIComponent(map.version)}`;
  return {
    maps: async (signal) => {
      const answer = await json<MapList>('/v1/maps', 'maps', signal);
      // Without an active version there is nothing to show yet.
      const shown = answer.maps.filter((map) => (map as { version: string | null }).version !== null);
      return { maps: shown, refused: answer.refused ?? [] };
    },
    map: (name, signal) => json<MapDetails>(mapPath(name), 'tiles', signal),
    trajectory: async (map, signal) =>
      (await json<{ poses: Pose[] }>(`${versioned(map)}/trajectory`, 'poses', signal)).poses,
    objects: async (map, signal) =>
      (await json<{ objects: Box[] }>(`${versioned(map)}/objects`, 'objects', signal)).objects,
    tile: async (map, tile, signal) => {
      const path = `${versioned(map)}/tiles/${tile.level}/${tile.x}/${tile.y}`;
      const response = await request(get, path, kTileTimeoutS, signal);
      return body(path, () => response.arrayBuffer(), signal);
    },
  };
}

function mapPath(name: string): string {
  return `/v1/maps/${encodeURIComponent(name)}`;
}

async function request(get: typeof fetch, path: string, timeout_s: number, signal: AbortSignal): Promise<Response> {
  const late = new AbortController();
  const timer = setTimeout(() => late.abort(), 1000 * timeout_s);
  const give_up = (): void => late.abort();
  signal.addEventListener('abort', give_up);
  try {
    const response = await get(path, { signal: late.signal });
    if (!response.ok) throw new ApiError(await refusal(path, response), true);
    return response;
  } catch (error) {
    if (error instanceof ApiError) throw error;
    signal.throwIfAborted();
    const how = late.signal.aborted ? `did not answer within ${timeout_s} s` : 'does not answer';
    throw new ApiError(`The server ${how}. Check that “stillmap serve” is running, then press Reload.`, false);
  } finally {
    clearTimeout(timer);
    signal.removeEventListener('abort', give_up);
  }
}

async function body<Body>(path: string, read: () => Promise<Body>, signal: AbortSignal): Promise<Body> {
  try {
    return await read();
  } catch (error) {
    signal.throwIfAborted();
    const reason = error instanceof SyntaxError ? 'is not JSON' : 'broke off';
    throw new ApiError(`The answer to ${path} ${reason}.`, true);
  }
}

// Problem details (RFC 9457) where the server sends them, else the bare status.
async function refusal(path: string, response: Response): Promise<string> {
  const bare = `The server answered ${path} with status ${response.status}`;
  if (!(response.headers.get('content-type') ?? '').includes('application/problem+json')) return `${bare}.`;
  const problem = (await response.json().catch(() => ({}))) as Record<string, unknown>;
  const said = [problem['title'], problem['detail']].filter((text) => typeof text === 'string').join(': ');
  const request = typeof problem['request_id'] === 'string' ? ` Request ${problem['request_id']}.` : '';
  return said === '' ? `${bare}.` : `The server refused: ${said} (status ${response.status}).${request}`;
}

import { ApiError } from '../api/errors.js';
import { jsonOf, send } from '../api/send.js';
import type { Geodetic } from '../scene/geodetic.js';
import type { GridHead } from '../scene/grid_map.js';
import type { RegionTile } from '../scene/region.js';
import { gather, type ObjectEntry, type SeenObject } from '../scene/seen_objects.js';
import type { Loop, TrackPose } from '../scene/track_layer.js';
import type { Vec3 } from '../scene/types.js';

/** What is known of a version before its points are there. */
export interface MapFacts {
  readonly name: string;
  readonly version: string;
  readonly frame_id: string;
  readonly origin: Vec3;
  readonly geodetic_origin?: Geodetic;
  readonly voxel_size_m: number;
  readonly tiles: readonly RegionTile[];
  readonly objects: number;
  readonly poses: number;
}

/** What is drawn beside the points. */
export interface MapSigns {
  readonly objects: readonly SeenObject[];
  readonly poses: readonly TrackPose[];
  readonly keyframes: readonly number[];
  /** Undefined when this version does not say. */
  readonly loops: readonly Loop[] | undefined;
}

export function versionPath(name: string, version: string): string {
  return `/v1/maps/${encodeURIComponent(name)}/versions/${encodeURIComponent(version)}`;
}

/** @param version the active one when undefined. @throws ApiError in words; AbortError when `signal` fires. */
export async function loadFacts(name: string, version: string | undefined, signal: AbortSignal): Promise<MapFacts> {
  const path = version === undefined ? `/v1/maps/${encodeURIComponent(name)}` : versionPath(name, version);
  const facts = (await get(path, signal)) as MapFacts;
  if (!Array.isArray(facts.tiles) || !Array.isArray(facts.origin)) {
    throw new ApiError('garbled', `The map “${name}” has no version that can be shown yet.`);
  }
  return facts;
}

export async function loadSigns({ name, version }: MapFacts, signal: AbortSignal): Promise<MapSigns> {
  const path = versionPath(name, version);
  const [objects, trajectory, graph] = await Promise.all([
    get(`${path}/objects`, signal) as Promise<{ objects: ObjectEntry[] }>,
    get(`${path}/trajectory`, signal) as Promise<{ poses: TrackPose[] }>,
    unlessMissing(get(`${path}/graph`, signal)) as Promise<{ key_frames: number[]; loops: Loop[] | null } | undefined>,
  ]);
  return {
    objects: gather(objects.objects), poses: trajectory.poses,
    keyframes: graph?.key_frames ?? [], loops: graph?.loops ?? undefined,
  };
}

/** A layer's head, its heights and the values of one of its bands. */
export interface GridAnswer {
  readonly head: GridHead;
  readonly heights: Float32Array;
  readonly values: Float32Array;
}

export async function loadGrid({ name, version }: MapFacts, layer: string, band: string, signal: AbortSignal): Promise<GridAnswer> {
  const head = (await get(`${versionPath(name, version)}/layers/${layer}`, signal)) as GridHead;
  const values = async (wanted: string): Promise<Float32Array> => {
    const url = head.bands.find((one) => one.name === wanted)?.url;
    if (url === undefined) throw new ApiError('garbled', `The layer “${layer}” has no values named “${wanted}”.`);
    const bytes = await (await send('GET', url, { signal })).arrayBuffer();
    return new Float32Array(bytes, 0, Math.floor(bytes.byteLength / 4));
  };
  const [heights, wanted] = await Promise.all([values('height'), values(band)]);
  return { head, heights, values: wanted };
}

async function get(path: string, signal: AbortSignal): Promise<unknown> {
  return jsonOf(await send('GET', path, { signal }), `GET ${path}`);
}

// Versions made elsewhere, and older servers, may have no such thing.
async function unlessMissing<Data>(answer: Promise<Data>): Promise<Data | undefined> {
  try {
    return await answer;
  } catch (error) {
    if (error instanceof ApiError && error.status === 404) return undefined;
    throw error;
  }
}

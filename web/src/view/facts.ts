import { ask } from '../api/client.js';
import { ApiError } from '../api/errors.js';
import { send } from '../api/send.js';
import type { Geodetic } from '../scene/geodetic.js';
import type { GridHead } from '../scene/grid_map.js';
import { gather, type SeenObject } from '../scene/seen_objects.js';
import type { MapBounds } from '../scene/scene_origin.js';
import type { Loop, TrackPose } from '../scene/track_layer.js';
import type { Vec3 } from '../scene/types.js';

/** Facts of a version that are loaded before its points. */
export interface MapFacts {
  readonly name: string;
  readonly version: string;
  readonly origin: Vec3;
  readonly geodetic_origin?: Geodetic;
  readonly voxel_size_m: number;
  readonly bounds: MapBounds | undefined;
}

/** What is drawn in addition to the points. */
export interface MapSigns {
  readonly objects: readonly SeenObject[];
  readonly poses: readonly TrackPose[];
  readonly keyframes: readonly number[];
  /** Undefined if the version does not have them. */
  readonly loops: readonly Loop[] | undefined;
}

/** @param version the active one when undefined. @throws ApiError; AbortError when `signal` fires. */
export async function loadFacts(name: string, version: string | undefined, signal: AbortSignal): Promise<MapFacts> {
  const { data } = version === undefined ? await ask('get', '/v1/maps/{map}', { path: { map: name }, signal })
    : await ask('get', '/v1/maps/{map}/versions/{version}', { path: { map: name, version }, signal });
  const { origin, voxel_size_m, geodetic_origin, bounds } = data;
  if (data.version === null || origin === undefined || voxel_size_m === undefined) {
    throw new ApiError('garbled', `The map “${name}” has no active version yet. Activate one on the map’s page.`);
  }
  return { name, version: data.version, origin: origin as unknown as Vec3, voxel_size_m, bounds, ...(geodetic_origin && { geodetic_origin }) };
}

export async function loadSigns({ name, version }: MapFacts, signal: AbortSignal): Promise<MapSigns> {
  const options = { path: { map: name, version }, signal };
  const [objects, trajectory, graph] = await Promise.all([
    ask('get', '/v1/maps/{map}/versions/{version}/objects', options),
    ask('get', '/v1/maps/{map}/versions/{version}/trajectory', options),
    unlessMissing(ask('get', '/v1/maps/{map}/versions/{version}/graph', options)),
  ]);
  return {
    objects: gather(objects.data.objects), poses: trajectory.data.poses as unknown as TrackPose[],
    keyframes: graph?.data.key_frames ?? [], loops: graph?.data.loops ?? undefined,
  };
}

/** A layer's header, its heights and the values of one band. */
export interface GridAnswer {
  readonly head: GridHead;
  readonly heights: Float32Array;
  readonly values: Float32Array;
}

export async function loadGrid({ name, version }: MapFacts, layer: string, band: string, signal: AbortSignal): Promise<GridAnswer> {
  const { data: head } = await ask('get', '/v1/maps/{map}/versions/{version}/layers/{layer}', { path: { map: name, version, layer }, signal });
  const values = async (wanted: string): Promise<Float32Array> => {
    const url = head.bands.find((one) => one.name === wanted)?.url;
    if (url === undefined) throw new ApiError('garbled', `The layer “${layer}” has no band “${wanted}”: this version was built by an older mapper. Rebuild it to see the layer.`);
    const bytes = await (await send('GET', url, { signal })).arrayBuffer();
    return new Float32Array(bytes, 0, Math.floor(bytes.byteLength / 4));
  };
  const [heights, wanted] = await Promise.all([values('height'), values(band)]);
  return { head, heights, values: wanted };
}

// Imported versions and older servers may not have it.
async function unlessMissing<Data>(answer: Promise<Data>): Promise<Data | undefined> {
  try {
    return await answer;
  } catch (error) {
    if (error instanceof ApiError && error.status === 404) return undefined;
    throw error;
  }
}

import { addressOf, ask, type Schema } from '../api/client.js';
import { jsonOf, send, sleep } from '../api/send.js';
import type { Difference } from './difference.js';
import { sceneOrigin } from '../scene/scene_origin.js';
import type { Vec3 } from '../scene/types.js';
import { glbPoints, type GlbPoints } from './glb.js';

/** What of a version is needed to show it. */
export interface Version {
  name: string;
  origin: [number, number, number];
  /** Of a picture of it, in map coordinates [m]. */
  scene_origin: Vec3;
  voxel_size_m: number;
  points: number;
}

type About = Schema<'Map'>;

export async function aboutVersion(map: string, version: string, signal: AbortSignal): Promise<Version> {
  const about: About = (await ask('get', '/v1/maps/{map}/versions/{version}', { path: { map, version }, signal })).data;
  const origin = (about.origin ?? [0, 0, 0]) as [number, number, number];
  return {
    name: version,
    origin,
    scene_origin: sceneOrigin(origin, about.bounds),
    voxel_size_m: about.voxel_size_m ?? 0.1,
    points: about.points ?? 0,
  };
}

export async function versionNames(map: string, signal: AbortSignal): Promise<string[]> {
  const { data } = await ask('get', '/v1/maps/{map}/versions', { path: { map }, signal });
  return data.versions.map(({ version }) => version);
}

/**
 * The differences between two versions of a map; waits while the server computes them.
 *
 * @param onProgress called with the share that is done, in [0, 1]; null when it is unknown.
 * @throws ApiError (`OtherFrame` when the versions cannot be compared); AbortError.
 */
export async function difference(
  pair: { map: string; version: string; other: string }, tolerance_m: number | null, onProgress: (share: number | null) => void, signal: AbortSignal,
): Promise<Difference> {
  const path = addressOf('/v1/maps/{map}/versions/{version}/difference/{other}', pair, { tolerance_m: tolerance_m ?? undefined });
  for (;;) {
    const response = await send('GET', path, { signal });
    const answer = (await jsonOf(response, `GET ${path}`)) as Difference | { state: 'making'; progress: number | null };
    if (answer.state === 'ready') return answer;
    onProgress(answer.progress);
    await sleep(Number(response.headers.get('retry-after') ?? 1) || 1, signal);
  }
}

/** Points of one side of a difference in a tile. */
export async function differencePoints(url: string, signal: AbortSignal): Promise<GlbPoints> {
  return glbPoints(await (await send('GET', url, { signal })).arrayBuffer());
}

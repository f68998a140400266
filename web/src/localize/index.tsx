import './localize.css';
import { ask } from '../api/client.js';
import { linkTo } from '../state/router.js';
import { useLoad } from '../ui/load.js';
import { Empty, Trouble } from '../ui/parts.js';
import type { ViewProps } from '../state/router.js';
import type { ShownMap } from './map_scene.js';
import type { Pose } from './pose.js';
import { Workplace } from './workplace.js';

interface Loaded extends ShownMap {
  geodetic: boolean;
  poses: Pose[];
}

/** Finds scans in a map and shows its vehicles: `#/localize/MAP` or `#/localize/MAP/VERSION`. */
export default function LocalizeView({ path, query }: ViewProps) {
  const [map = '', version] = path;
  const { data, error, reload } = useLoad((signal) => load(map, version, signal), [map, version]);
  if (error !== undefined && data === undefined) {
    return <div class="page"><Trouble error={error} onRetry={reload} title={`${map} cannot be shown`} /></div>;
  }
  if (data === undefined) return <p class="waiting" role="status">Loading the map…</p>;
  if (data === null) {
    return (
      <div class="page">
        <Empty title={`${map} has no active version`}>
          <p>Scans are localized in the active version. <a href={linkTo('maps', [map])}>Activate a version</a></p>
        </Empty>
      </div>
    );
  }
  return (
    <Workplace
      key={`${data.name}/${data.version}`} map={data} place={{ map, version: version ?? null }} geodetic={data.geodetic}
      poses={data.poses} query={query}
    />
  );
}

/** @return null for a map without an active version. */
async function load(map: string, version: string | undefined, signal: AbortSignal): Promise<Loaded | null> {
  const about = version === undefined
    ? (await ask('get', '/v1/maps/{map}', { path: { map }, signal })).data
    : (await ask('get', '/v1/maps/{map}/versions/{version}', { path: { map, version }, signal })).data;
  const { origin, voxel_size_m, tile_size_m, bounds } = about;
  const name = version ?? about.version;
  if (name === null || origin === undefined) return null;
  const { data: { poses } } = await ask('get', '/v1/maps/{map}/versions/{version}/trajectory', { path: { map, version: name }, signal });
  return {
    name: map, version: name, origin: origin as Loaded['origin'], voxel_size_m: voxel_size_m ?? 0.1, tile_size_m: tile_size_m ?? 20,
    bounds,
    geodetic: about.geodetic_origin !== undefined, poses: poses as unknown as Pose[],
  };
}

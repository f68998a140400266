import { ask, type Schema } from '../api/client.js';
import { area, bytes, date, number, plural } from '../ui/format.js';
import { useLoad } from '../ui/load.js';

/** Numbers of the active version, and how many pose requests it answered. */
export function MapFacts({ name, active }: { name: string; active: string | undefined }) {
  const details = useLoad(async (signal) =>
    active === undefined ? undefined
      : (await ask('get', '/v1/maps/{map}/versions/{version}', { path: { map: name, version: active }, signal })).data, [name, active]);
  const stats = useLoad(async (signal) => (await ask('get', '/v1/maps/{map}/stats', { path: { map: name }, signal })).data,
    [name, active], { everyS: 5 });
  const map = details.data;
  if (active === undefined) {
    return <div class="card map-facts"><p class="quiet">No version is active, so vehicles get no poses in this map. Upload a version or build one from drives, then activate it.</p></div>;
  }
  const facts: [string, string | undefined][] = [
    ['Area', map?.area_m2 === undefined ? undefined : area(map.area_m2)],
    ['Points', map?.points === undefined ? undefined : number(map.points)],
    ['Size', map?.bytes === undefined ? undefined : bytes(map.bytes)],
    ['Voxel', map?.voxel_size_m === undefined ? undefined : `${map.voxel_size_m} m`],
    ['Objects removed', map?.objects === undefined ? undefined : number(map.objects)],
    ['Trajectory', map?.poses === undefined ? undefined : plural(map.poses, 'pose')],
    ['Frame', map?.frame_id],
    ['Position on Earth', map === undefined ? undefined : placeOf(map.geodetic_origin)],
    ['Built', map === undefined ? undefined : date(map.created_ns)],
  ];
  return (
    <div class="card map-facts">
      <dl class="facts">
        {facts.map(([term, value]) => value !== undefined && <div key={term}><dt>{term}</dt><dd>{value}</dd></div>)}
      </dl>
      {stats.data !== undefined && <Requests stats={stats.data} />}
    </div>
  );
}

function placeOf(origin: { latitude_deg: number; longitude_deg: number } | undefined): string {
  return origin === undefined ? 'unknown' : `${origin.latitude_deg.toFixed(6)}°, ${origin.longitude_deg.toFixed(6)}°`;
}

function Requests({ stats }: { stats: Schema<'MapStats'> }) {
  const { ok, degraded, lost } = stats.queries;
  const all = ok + degraded + lost;
  const { total } = stats.latency_ms;
  return (
    <div class="asked">
      <h3>Pose requests since the server started</h3>
      {all === 0 ? <p class="quiet">None so far.</p> : (
        <>
          <div class="shares" role="img" aria-label={`${ok} ok, ${degraded} degraded, ${lost} lost`}>
            {([['ok', ok], ['degraded', degraded], ['lost', lost]] as const).map(([kind, count]) =>
              count > 0 && <span key={kind} class={kind} style={{ flexGrow: count }} />)}
          </div>
          <p class="quiet number">
            {number(ok)} ok · {number(degraded)} degraded · {number(lost)} lost
            {total !== null && ` · ${number(total.p50, 0)} ms median, ${number(total.p95, 0)} ms 95th percentile`}
          </p>
        </>
      )}
      {stats.sessions > 0 && <p class="quiet">{plural(stats.sessions, 'vehicle')} now in this map.</p>}
    </div>
  );
}

import { useState } from 'preact/hooks';
import { ask, versionPath } from '../api/client.js';
import { linkTo } from '../state/router.js';
import { UploadDialog } from '../upload/dialog.js';
import { DropZone } from '../upload/drop_zone.js';
import type { Chosen } from '../upload/chosen.js';
import { age, area, bytes, date, plural, short } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { useLoad } from '../ui/load.js';
import { Badge, Empty, Trouble } from '../ui/parts.js';
import { Picture } from '../ui/picture.js';
import { NewMapDialog } from './new_map_dialog.js';
import { stateOf, type JobRow, type MapRow, type Refused } from './facts.js';

const kEveryS = 4;
const kHealthEveryS = 20;
const kFilterFrom = 8;

/** The list of maps, reloaded every few seconds. */
export function MapsPage() {
  const maps = useLoad((signal) => ask('get', '/v1/maps', { signal }), [], { everyS: kEveryS });
  const jobs = useLoad((signal) => ask('get', '/v1/jobs', { query: { status: 'processing', limit: 50 }, signal }), [], { everyS: kEveryS });
  const health = useLoad((signal) => ask('get', '/readyz', { signal, patience: 0 }), [], { everyS: kHealthEveryS });
  const [dialog, setDialog] = useState<'upload' | 'new' | { chosen: Chosen }>();
  const [filter, setFilter] = useState('');
  const close = (): void => setDialog(undefined);
  const list = maps.data?.data;
  const shown = list?.maps.filter(({ name }) => name.includes(filter.trim().toLowerCase()));
  return (
    <DropZone onChosen={(chosen) => setDialog({ chosen })}>
      <div class="heading">
        <h1>Maps</h1>
        {list !== undefined && <span class="quiet">{plural(list.maps.length, 'map')}</span>}
        <span class="grow" />
        {list !== undefined && list.maps.length >= kFilterFrom && (
          <input
            type="search" class="filter" placeholder="Filter by name" aria-label="Filter by name" value={filter}
            onInput={(event) => setFilter(event.currentTarget.value)}
          />
        )}
        <button type="button" onClick={() => setDialog('new')}><Icon name="plus" /> New map</button>
        <button type="button" class="primary" onClick={() => setDialog('upload')}><Icon name="upload" /> Upload</button>
      </div>
      {health.data?.data.reasons.filter(ofTheServer).map((reason) => <p key={reason} class="server-trouble" role="status">{sentence(reason)}</p>)}
      {maps.error !== undefined && <Trouble error={maps.error} onRetry={maps.reload} />}
      {list === undefined && maps.loading && <p class="waiting" role="status">Loading the maps…</p>}
      {shown !== undefined && list !== undefined && (shown.length > 0
        ? <MapTable maps={shown} refused={list.refused} jobs={jobs.data?.data.jobs ?? []} />
        : <NoMaps filtered={list.maps.length > 0} />)}
      {dialog === 'new' && <NewMapDialog onClose={close} />}
      {dialog === 'upload' && <UploadDialog onClose={close} />}
      {typeof dialog === 'object' && <UploadDialog chosen={dialog.chosen} onClose={close} />}
    </DropZone>
  );
}

/** Faults of a single map are shown beside it in the list. */
function ofTheServer(reason: string): boolean {
  return !/^(map |\d+ maps?: )/.test(reason);
}

function sentence(text: string): string {
  return `${text.charAt(0).toUpperCase()}${text.slice(1)}.`;
}

function NoMaps({ filtered }: { filtered: boolean }) {
  if (filtered) return <Empty title="No map matches this filter" />;
  return (
    <Empty title="No maps yet">
      <p>Drop a map package, a LAS, PCD or PLY map, or a drive anywhere on this page. Or build a map on the command line:</p>
      <code>stillmap build DRIVE -o MAP && stillmap store add STORE NAME v1 MAP --activate</code>
    </Empty>
  );
}

function MapTable({ maps, refused, jobs }: { maps: readonly MapRow[]; refused: readonly Refused[]; jobs: readonly JobRow[] }) {
  return (
    <div class="card table-frame">
      <table class="maps">
        <thead>
          <tr>
            <th scope="col"><span class="unseen">Picture</span></th><th scope="col">Map</th><th scope="col">Active version</th>
            <th scope="col" class="end">Area</th><th scope="col" class="end">Points</th><th scope="col" class="end">Size</th>
            <th scope="col">Stored</th><th scope="col"><span class="unseen">Actions</span></th>
          </tr>
        </thead>
        <tbody>
          {maps.map((map) => (
            <Row
              key={map.name} map={map} refused={refused.find(({ name }) => name === map.name)}
              job={jobs.find((job) => job.map === map.name)}
            />
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Row({ map, refused, job }: { map: MapRow; refused: Refused | undefined; job: JobRow | undefined }) {
  const state = stateOf(map);
  const path = map.version === null ? undefined : `${versionPath(map.name, map.version)}/preview`;
  const since = map.version === null ? undefined : map.version_created_ns ?? map.created_ns;
  return (
    <tr data-map={map.name} data-map-state={map.state}>
      <td class="thumb"><a href={linkTo('maps', [map.name])} tabIndex={-1} aria-hidden="true"><Picture path={path} label="" /></a></td>
      <th scope="row" class="name">
        <a href={linkTo('maps', [map.name])}>{map.name}</a>
        <span class="badges">
          <Badge tone={state.tone}>{state.text}</Badge>
          {job !== undefined && (
            <a class="badge live" href={linkTo('jobs', [String(job.id)])}>
              {job.kind === 'convert' ? 'Converting' : 'Building'}{job.progress === null ? '' : ` ${Math.floor(100 * job.progress)} %`}
            </a>
          )}
        </span>
        {refused !== undefined && <span class="fault">{refused.reason}</span>}
      </th>
      <td>{map.version ?? '–'}</td>
      <td class="end number">{map.area_m2 === undefined ? '–' : area(map.area_m2)}</td>
      <td class="end number">{map.points === undefined ? '–' : short(map.points)}</td>
      <td class="end number">{map.bytes === undefined ? '–' : bytes(map.bytes)}</td>
      <td title={since === undefined ? undefined : date(since)}>{since === undefined ? 'never' : age(since)}</td>
      <td class="end"><Actions map={map} /></td>
    </tr>
  );
}

function Actions({ map }: { map: MapRow }) {
  if (map.version === null) return <a class="button small" href={linkTo('maps', [map.name])}>Open</a>;
  return (
    <div class="actions end">
      <a class="button small" href={linkTo('view', [map.name, map.version])} aria-label={`View ${map.name} in 3D`}>
        <Icon name="eye" /> View
      </a>
      <a class="button small" href={linkTo('localize', [map.name])} aria-label={`Localize in ${map.name}`}>
        <Icon name="pin" /> Localize
      </a>
    </div>
  );
}

import { useState } from 'preact/hooks';
import { ask, versionPath } from '../api/client.js';
import { go, linkTo } from '../state/router.js';
import type { Chosen } from '../upload/chosen.js';
import { UploadDialog } from '../upload/dialog.js';
import { DropZone } from '../upload/drop_zone.js';
import { Icon } from '../ui/icon.js';
import { useLoad } from '../ui/load.js';
import { Badge, Trouble } from '../ui/parts.js';
import { Picture } from '../ui/picture.js';
import { say } from '../ui/notices.js';
import { Confirm } from '../ui/confirm.js';
import { DrivesSection } from './drives_section.js';
import { stateOf, type MapRow, type Refused } from './facts.js';
import { MapFacts } from './map_facts.js';
import { MapJobs } from './map_jobs.js';
import { RolloutSection, VehiclesSection } from './rollout_section.js';
import { UnfinishedUploads } from './unfinished_uploads.js';
import { VersionsSection } from './versions_section.js';

const kEveryS = 4;

/** One map: its picture, versions, drives and jobs, with their actions. */
export function MapPage({ name }: { name: string }) {
  const [dialog, setDialog] = useState<'upload' | 'delete' | { chosen: Chosen }>();
  const list = useLoad((signal) => ask('get', '/v1/maps', { signal }), [], { everyS: kEveryS });
  const versions = useLoad(
    (signal) => ask('get', '/v1/maps/{map}/versions', { path: { map: name }, signal }), [name], { everyS: kEveryS });
  const row = list.data?.data.maps.find((map) => map.name === name);
  const refused = list.data?.data.refused.find((map) => map.name === name);
  const close = (): void => setDialog(undefined);
  const reload = (): void => {
    list.reload();
    versions.reload();
  };
  if (versions.error?.code === 'UnknownMap') return <Gone name={name} />;
  const active = versions.data?.data.version ?? undefined;
  return (
    <DropZone onChosen={(chosen) => setDialog({ chosen })}>
      <MapHeading name={name} row={row} active={active} onUpload={() => setDialog('upload')} onDelete={() => setDialog('delete')} />
      {versions.error !== undefined && <Trouble error={versions.error} onRetry={reload} />}
      <Failure refused={refused} />
      <div class="map-top">
        <div class="card map-picture">
          <Picture path={active === undefined ? undefined : `${versionPath(name, active)}/preview`} label={`${name} from above`} />
        </div>
        <MapFacts name={name} active={active} />
      </div>
      {versions.data !== undefined && (
        <VersionsSection map={name} list={versions.data.data} etag={versions.data.etag} onChange={reload} />
      )}
      <RolloutSection map={name} active={active} etag={versions.data?.etag} onChange={reload} />
      <UnfinishedUploads map={name} />
      <DrivesSection map={name} />
      <VehiclesSection map={name} />
      <MapJobs map={name} onEnd={reload} />
      {dialog === 'upload' && <UploadDialog map={name} onClose={close} />}
      {typeof dialog === 'object' && <UploadDialog map={name} chosen={dialog.chosen} onClose={close} />}
      {dialog === 'delete' && <DeleteMap name={name} active={active} onClose={close} />}
    </DropZone>
  );
}

function Gone({ name }: { name: string }) {
  return (
    <div class="empty" role="alert">
      <h2>There is no map “{name}”</h2>
      <p>Somebody may have deleted it. Go back to the list of maps.</p>
      <a class="button" href={linkTo('maps')}>All maps</a>
    </div>
  );
}

function Failure({ refused }: { refused: Refused | undefined }) {
  if (refused === undefined) return null;
  return (
    <div class="trouble" role="alert">
      <Icon name="warning" />
      <div><strong>Version {refused.version} cannot be served</strong><p>{refused.reason}</p></div>
    </div>
  );
}

interface HeadingProps {
  name: string;
  row: MapRow | undefined;
  active: string | undefined;
  onUpload: () => void;
  onDelete: () => void;
}

function MapHeading({ name, row, active, onUpload, onDelete }: HeadingProps) {
  const state = row === undefined ? undefined : stateOf(row);
  return (
    <div class="heading">
      <a class="button plain" href={linkTo('maps')} aria-label="Back to all maps"><Icon name="back" /></a>
      <h1>{name}</h1>
      {state !== undefined && <Badge tone={state.tone}>{state.text}</Badge>}
      {active !== undefined && <span class="quiet">{active} is active</span>}
      <span class="grow" />
      {active !== undefined && (
        <>
          <a class="button primary" href={linkTo('view', [name, active])}><Icon name="eye" /> View</a>
          <a class="button" href={linkTo('localize', [name])}><Icon name="pin" /> Localize</a>
        </>
      )}
      <a class="button" href={linkTo('maps', [name, 'rebuild'])}><Icon name="build" /> Rebuild</a>
      <button type="button" onClick={onUpload}><Icon name="upload" /> Upload</button>
      <button type="button" onClick={onDelete}><Icon name="trash" /> Delete</button>
    </div>
  );
}

function DeleteMap({ name, active, onClose }: { name: string; active: string | undefined; onClose: () => void }) {
  const act = async (): Promise<void> => {
    await ask('delete', '/v1/maps/{map}', { path: { map: name }, query: active === undefined ? {} : { active: true } });
    say({ kind: 'good', text: `Deleted ${name}.` });
    go(linkTo('maps'));
  };
  return (
    <Confirm title={`Delete ${name}?`} verb="Delete the map" danger word={name} act={act} onClose={onClose}>
      <p>
        All versions of the map are deleted{active === undefined ? '' : ', the active one too: vehicles then get no poses in this map'}.
        You cannot undo this. The server refuses it while the map has drives or unfinished jobs: delete or cancel those first.
      </p>
    </Confirm>
  );
}

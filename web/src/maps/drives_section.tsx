import { useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { Confirm } from '../ui/confirm.js';
import { age, bytes, date, duration, firstUpper, plural } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { useLoad } from '../ui/load.js';
import { say } from '../ui/notices.js';
import { Badge, Trouble, type Tone } from '../ui/parts.js';
import { useStore } from '../state/store.js';
import { UploadDialog } from '../upload/dialog.js';
import { dismissDrive, uploads } from '../upload/manager.js';
import { forgetUpload, remembered } from '../upload/remembered.js';
import { asOnPage, choiceOf, undecided, type Selected } from '../upload/topics.js';
import { TopicsForm } from '../upload/topics_form.js';
import type { DriveRow } from './facts.js';

const kWords: Record<DriveRow['status'], { tone: Tone; text: string }> = {
  open: { tone: 'warn', text: 'Incomplete' },
  needs_choice: { tone: 'warn', text: 'Needs a choice' },
  complete: { tone: 'good', text: 'Complete' },
  failed: { tone: 'bad', text: 'Failed' },
};

/** A recording is read from its beginning to its end. */
const kOpenS = 3600;

const kUploading = { tone: 'live', text: 'Uploading' } as const;

/** The drives from which versions of a map can be built. */
export function DrivesSection({ map }: { map: string }) {
  const drives = useLoad((signal) => ask('get', '/v1/maps/{map}/drives', { path: { map }, signal }), [map], { everyS: 5 });
  const [open, setOpen] = useState<{ what: 'resume' | 'choose' | 'delete'; drive: DriveRow }>();
  const list = drives.data?.data.drives;
  const close = (): void => setOpen(undefined);
  return (
    <section aria-labelledby="drives">
      <div class="heading"><h2 id="drives">Drives</h2></div>
      {drives.error !== undefined && (list === undefined || drives.error.trouble !== 'down') && <Trouble error={drives.error} onRetry={drives.reload} />}
      {list?.length === 0 && <p class="quiet">No drives yet. Drop a drive here, as a folder or a tar: new versions are built from drives.</p>}
      {list !== undefined && list.length > 0 && (
        <div class="card table-frame">
          <table class="drives">
            <thead>
              <tr>
                <th scope="col">Drive</th><th scope="col">State</th><th scope="col" class="end">Size</th><th scope="col">Started</th>
                <th scope="col"><span class="unseen">Actions</span></th>
              </tr>
            </thead>
            <tbody>
              {list.map((drive) => (
                <Row key={drive.id} drive={drive} onOpen={(what) => setOpen({ what, drive })} />
              ))}
            </tbody>
          </table>
        </div>
      )}
      {open?.what === 'resume' && <UploadDialog map={map} resume={{ ...open.drive, kind: 'drive' }} onClose={close} />}
      {open?.what === 'choose' && <ChooseTopics drive={open.drive} onClose={close} onChange={drives.reload} />}
      {open?.what === 'delete' && <DeleteDrive drive={open.drive} onClose={close} onChange={drives.reload} />}
    </section>
  );
}

function Row({ drive, onOpen }: { drive: DriveRow; onOpen: (what: 'resume' | 'choose' | 'delete') => void }) {
  const here = useStore(uploads).some(({ plan, transfer }) =>
    plan.map === drive.map && plan.kind === 'drive' && plan.name === drive.name
    && !['canceled', 'failed', 'done'].includes(transfer.view.get().state));
  const known = remembered().find((one) => one.map === drive.map && one.collection === 'drives' && one.id === drive.id);
  const state = here && drive.status === 'open' ? kUploading : kWords[drive.status];
  return (
    <tr data-drive={drive.id}>
      <th scope="row" class="name">
        {drive.name === '' ? `Drive ${drive.id}` : drive.name} <span class="quiet">drive {drive.id}</span>
        {drive.status === 'failed' && <span class="fault">{drive.error}</span>}
        <Inspected drive={drive} />
      </th>
      <td>
        <Badge tone={state.tone}>{state.text}</Badge>
        {drive.status === 'open' && known !== undefined && known.bytes > 0 && (
          <span class="quiet"> {Math.floor((100 * drive.bytes) / known.bytes)} % of {bytes(known.bytes)}</span>
        )}
      </td>
      <td class="end number">{bytes(drive.bytes)}</td>
      <td title={date(drive.created_ns)}>{age(drive.created_ns)}</td>
      <td class="end">
        <div class="actions end">
          {drive.status === 'open' && !here && <button type="button" class="small" onClick={() => onOpen('resume')}>Resume the upload</button>}
          {drive.status === 'needs_choice' && <button type="button" class="small" onClick={() => onOpen('choose')}>Choose topics</button>}
          <button type="button" class="plain small" aria-label={`Delete the drive ${drive.name}`} onClick={() => onOpen('delete')}><Icon name="trash" /></button>
        </div>
      </td>
    </tr>
  );
}

/** What `stillmap inspect` says of a drive: what looks wrong is shown, what the reader did can be opened. */
function Inspected({ drive: { inspection } }: { drive: DriveRow }) {
  if (inspection === null || inspection.scans === 0) return null;
  const { scans, duration_s, topic, findings, notes } = inspection;
  return (
    <div class="inspected">
      <span class="quiet">{plural(scans, 'scan')}, {duration(duration_s)}{topic !== '' && ` of ${topic}`}</span>
      {findings.map(({ code, what, remedy }) => (
        <p key={code} class="finding" data-code={code}><Icon name="warning" /> {firstUpper(what)}. <span class="quiet">{firstUpper(remedy)}.</span></p>
      ))}
      {notes.length > 0 && (
        <details>
          <summary>{plural(notes.length, 'note')}</summary>
          <ul>{notes.map((note) => <li key={note}>{note}</li>)}</ul>
        </details>
      )}
    </div>
  );
}

/** Asks which topics of a recording are used. The server keeps asking while it cannot read it so. */
function ChooseTopics({ drive, onClose, onChange }: { drive: DriveRow; onClose: () => void; onChange: () => void }) {
  const [now, setNow] = useState(drive);
  const [selected, setSelected] = useState<Selected>({});
  const topics = now.inspection?.choices ?? [];
  const choice = choiceOf(selected, topics);
  const ready = choice !== '' && undecided(topics, selected).length === 0;
  const act = async (): Promise<boolean> => {
    const { data } = await ask('post', '/v1/maps/{map}/drives/{drive}/complete', {
      path: { map: drive.map, drive: drive.id }, json: { choice }, timeoutS: kOpenS,
    });
    onChange();
    setNow(data);
    if (data.status !== 'complete') return false;
    dismissDrive(drive.map, drive.id);
    say({ kind: 'good', text: `The drive “${drive.name}” is complete.` });
    return true;
  };
  return (
    <Confirm title={`Choose the topics of “${drive.name}”`} verb="Use these topics" ready={ready} act={act} onClose={onClose}>
      <p class="remark" role="status">{firstUpper(asOnPage(now.error))}.</p>
      <TopicsForm topics={topics} selected={selected} onSelect={setSelected} withRest />
    </Confirm>
  );
}

function DeleteDrive({ drive, onClose, onChange }: { drive: DriveRow; onClose: () => void; onChange: () => void }) {
  const act = async (): Promise<void> => {
    await ask('delete', '/v1/maps/{map}/drives/{drive}', { path: { map: drive.map, drive: drive.id } });
    forgetUpload(drive.map, 'drives', drive.id);
    dismissDrive(drive.map, drive.id);
    say({ kind: 'good', text: `Deleted the drive “${drive.name}”.` });
    onChange();
  };
  return (
    <Confirm title={`Delete the drive “${drive.name}”?`} verb="Delete the drive" danger act={act} onClose={onClose}>
      <p>Versions that were built from it stay. No new version can be built from it. You cannot undo this.</p>
    </Confirm>
  );
}

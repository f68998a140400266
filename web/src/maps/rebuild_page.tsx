import { useMemo, useState } from 'preact/hooks';
import { ask, type Schema } from '../api/client.js';
import { toApiError, type ApiError } from '../api/errors.js';
import { watchJob } from '../jobs/watch.js';
import { go, linkTo } from '../state/router.js';
import { bytes, date, firstUpper } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { forget, useKept } from '../ui/kept.js';
import { useLoad } from '../ui/load.js';
import { Empty, Field, Trouble } from '../ui/parts.js';
import { faultOfName } from '../upload/names.js';
import { asOnPage } from '../upload/topics.js';
import type { DriveRow } from './facts.js';
import { kNoChoices, requestOf, type RebuildChoices } from './rebuild_choices.js';
import { RebuildOptions } from './rebuild_options.js';

type Request = Schema<'RebuildRequest'>;

/** The form that builds a new version of a map from its drives. The choices are kept over a reload. */
export function RebuildPage({ map }: { map: string }) {
  const drives = useLoad((signal) => ask('get', '/v1/maps/{map}/drives', { path: { map }, signal }), [map], { everyS: 5 });
  const all = drives.data?.data.drives;
  const complete = all?.filter(({ status }) => status === 'complete');
  return (
    <>
      <div class="heading">
        <a class="button plain" href={linkTo('maps', [map])} aria-label={`Back to ${map}`}><Icon name="back" /></a>
        <h1>Rebuild {map}</h1>
      </div>
      {drives.error !== undefined && <Trouble error={drives.error} onRetry={drives.reload} />}
      {all !== undefined && complete?.length === 0 && <NoDrive map={map} begun={all.filter(({ status }) => status !== 'failed')} />}
      {complete !== undefined && complete.length > 0 && <Form map={map} drives={complete} />}
    </>
  );
}

/** Says what is missing before anything can be built. @param begun drives that are not complete */
function NoDrive({ map, begun }: { map: string; begun: readonly DriveRow[] }) {
  const first = begun[0];
  return (
    <Empty title={first === undefined ? 'This map has no drives yet' : `“${nameOf(first)}” is not complete yet`}>
      {first === undefined ? <p>New versions are built from drives. Upload a drive on the map’s page, as a folder or a tar.</p>
        : first.status === 'needs_choice' ? <p>It needs a choice, which you make on the map’s page. {firstUpper(asOnPage(first.error))}.</p>
        : <p role="status">{bytes(first.bytes)} have arrived. This page continues when the drive is complete.</p>}
      <a class="button" href={linkTo('maps', [map])}>Open {map}</a>
    </Empty>
  );
}

function nameOf({ id, name }: DriveRow): string {
  return name === '' ? `Drive ${id}` : name;
}

function Form({ map, drives }: { map: string; drives: readonly DriveRow[] }) {
  const slot = `rebuild.${map}`;
  const [choices, setChoices] = useKept<RebuildChoices>(slot, { ...kNoChoices, drives: drives.map(({ id }) => id) });
  const [error, setError] = useState<ApiError>();
  const [busy, setBusy] = useState(false);
  const known = { ...kNoChoices, ...choices };
  const fault = faultOf(known, drives);
  const set = (change: Partial<RebuildChoices>): void => setChoices({ ...known, ...change });
  // A request that is sent again, for example after a lost answer, is the same job.
  const key = useMemo(() => crypto.randomUUID?.() ?? String(Math.random()), [JSON.stringify(known)]);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    if (fault !== undefined) return;
    setBusy(true);
    setError(undefined);
    try {
      const json = requestOf(known, drives) as Request;
      const { data } = await ask('post', '/v1/maps/{map}/rebuild', { path: { map }, json, headers: { 'Idempotency-Key': key } });
      forget(slot);
      watchJob(data.id);
      go(linkTo('jobs', [String(data.id)]));
    } catch (reason) {
      setError(toApiError(reason));
      setBusy(false);
    }
  };
  return (
    <form class="rebuild" onSubmit={(event) => void submit(event)}>
      <DriveChoice drives={drives} choices={known} set={set} />
      <RebuildOptions choices={known} set={set} />
      <fieldset class="card form-part">
        <legend>After the build</legend>
        <Field label="Name of the version" fault={known.version === '' ? undefined : faultOfName(known.version)} hint="If empty, it is named after the date and the job.">
          {(props) => <input {...props} value={known.version} placeholder="20261122-job12" onInput={(event) => set({ version: event.currentTarget.value })} />}
        </Field>
        <label class="check">
          <input type="checkbox" checked={known.activate} onChange={(event) => set({ activate: event.currentTarget.checked })} />
          <span>Activate it if it passes the checks<span class="hint block">Otherwise it is stored only, and you can activate it later.</span></span>
        </label>
        <label class="check">
          <input type="checkbox" checked={known.newFrame} onChange={(event) => set({ newFrame: event.currentTarget.checked })} />
          <span>Use a new map frame<span class="hint block">The same position then means another place than in the active version, and the checks treat it as a first version.</span></span>
        </label>
      </fieldset>
      {error !== undefined && <Trouble error={error} title="The server refused the rebuild" />}
      <div class="actions">
        {fault !== undefined && <p class="fault" role="status">{fault}</p>}
        <span class="grow" />
        <a class="button" href={linkTo('maps', [map])}>Cancel</a>
        <button type="submit" class="primary" disabled={busy || fault !== undefined}>{busy ? 'One moment…' : 'Start the rebuild'}</button>
      </div>
    </form>
  );
}

function faultOf(choices: RebuildChoices, drives: readonly DriveRow[]): string | undefined {
  if (!drives.some(({ id }) => choices.drives.includes(id) && id !== choices.heldBack)) return 'Choose at least one drive to build from.';
  if (choices.version !== '' && faultOfName(choices.version) !== undefined) return 'Change the name of the version: it cannot be used.';
  return undefined;
}

function DriveChoice({ drives, choices, set }: { drives: readonly DriveRow[]; choices: RebuildChoices; set: (change: Partial<RebuildChoices>) => void }) {
  const toggle = (id: number, on: boolean): void =>
    set({ drives: on ? [...choices.drives, id] : choices.drives.filter((other) => other !== id) });
  return (
    <fieldset class="card form-part">
      <legend>Drives</legend>
      <div class="drive-choice">
        {drives.map((drive) => (
          <label key={drive.id} class="check">
            <input
              type="checkbox" checked={choices.drives.includes(drive.id) && choices.heldBack !== drive.id}
              disabled={choices.heldBack === drive.id} onChange={(event) => toggle(drive.id, event.currentTarget.checked)}
            />
            <span>{nameOf(drive)} <span class="quiet">drive {drive.id} · {bytes(drive.bytes)} · {date(drive.created_ns)}</span></span>
          </label>
        ))}
      </div>
      <Field label="Check the map with" hint="Best is another drive through the same streets that is not part of the map. Without one, every tenth scan is held back.">
        {(props) => (
          <select {...props} value={choices.heldBack ?? ''} onChange={({ currentTarget: { value } }) => set({ heldBack: value === '' ? null : Number(value) })}>
            <option value="">Every tenth scan of the drives</option>
            {drives.map((drive) => <option key={drive.id} value={drive.id}>{nameOf(drive)} (drive {drive.id})</option>)}
          </select>
        )}
      </Field>
    </fieldset>
  );
}

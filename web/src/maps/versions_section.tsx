import { useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { failedItsChecks, type Job } from '../jobs/job.js';
import { linkTo } from '../state/router.js';
import { age, area, bytes, date, short } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { useLoad } from '../ui/load.js';
import { Badge } from '../ui/parts.js';
import { downloadPackage } from './download.js';
import { changedOptions, type VersionRow } from './facts.js';
import { RollOut } from './rollout_section.js';
import { Activate, DeleteVersion, RollBack } from './version_dialogs.js';

export interface VersionListData {
  version: string | null;
  previous_version: string | null;
  versions: readonly VersionRow[];
}

export interface VersionsProps {
  map: string;
  list: VersionListData;
  /** The map's revision. A change is refused if the map is no longer as shown here. */
  etag: string | undefined;
  onChange: () => void;
}

const kJobsAtOnce = 100;

type Open = { what: 'activate' | 'delete' | 'rollout'; version: string } | { what: 'rollback' };

/** A map's versions, newest first, with their actions. */
export function VersionsSection({ map, list, etag, onChange }: VersionsProps) {
  const [open, setOpen] = useState<Open>();
  const dialog = { map, etag, onChange, onClose: () => setOpen(undefined) };
  const failedJobs = useFailedJobs(map, list);
  const newestFirst = [...list.versions].reverse();
  return (
    <section aria-labelledby="versions">
      <div class="heading">
        <h2 id="versions">Versions</h2>
        <span class="grow" />
        {list.versions.length > 1 && <CompareChoice map={map} list={list} />}
        {list.previous_version !== null && (
          <button type="button" onClick={() => setOpen({ what: 'rollback' })}>Roll back to {list.previous_version}</button>
        )}
      </div>
      {newestFirst.length === 0 ? <p class="quiet">No versions yet. Upload one, or build one from drives.</p> : (
        <div class="card table-frame">
          <table class="versions">
            <thead>
              <tr>
                <th scope="col">Version</th><th scope="col">Stored</th><th scope="col" class="end">Area</th>
                <th scope="col" class="end">Points</th><th scope="col" class="end">Size</th><th scope="col">Built from</th>
                <th scope="col"><span class="unseen">Actions</span></th>
              </tr>
            </thead>
            <tbody>
              {newestFirst.map((version) => <Row key={version.version} map={map} list={list} version={version} failedJob={failedJobs.get(version.version)} onOpen={setOpen} />)}
            </tbody>
          </table>
        </div>
      )}
      {open?.what === 'activate' && <Activate {...dialog} version={open.version} active={list.version ?? undefined} failedJob={failedJobs.get(open.version)} />}
      {open?.what === 'rollout' && <RollOut {...dialog} version={open.version} />}
      {open?.what === 'delete' && <DeleteVersion {...dialog} version={open.version} />}
      {open?.what === 'rollback' && (
        <RollBack {...dialog} version={list.previous_version ?? ''} active={list.version ?? undefined} />
      )}
    </section>
  );
}

/** Versions that did not pass the checks of the job that built them, each with that job. */
function useFailedJobs(map: string, list: VersionListData): ReadonlyMap<string, number> {
  const names = list.versions.map(({ version }) => version);
  const { data } = useLoad((signal) => jobsThatMade(map, names, signal), [map, names]);
  return new Map((data ?? []).filter(failedItsChecks).map(({ id, result }) => [result?.version ?? '', id]));
}

/** The jobs that built these versions, as far as the server still knows them. */
async function jobsThatMade(map: string, versions: readonly string[], signal: AbortSignal): Promise<Job[]> {
  const made: Job[] = [];
  const wanted = new Set(versions);
  let before: number | undefined;
  while (wanted.size > 0) {
    const query = { map, status: 'succeeded', limit: kJobsAtOnce, ...(before !== undefined && { before }) } as const;
    const { data } = await ask('get', '/v1/jobs', { query, signal });
    made.push(...(data.jobs as Job[]).filter(({ result }) => wanted.delete(result?.version ?? '')));
    if (data.next === null) break;
    before = data.next;
  }
  return made;
}

interface RowProps {
  map: string;
  list: VersionListData;
  version: VersionRow;
  /** The job whose checks the version did not pass. */
  failedJob: number | undefined;
  onOpen: (open: Open) => void;
}

function Row({ map, list, version, failedJob, onOpen }: RowProps) {
  const { version: name } = version;
  const options = changedOptions(version.options);
  return (
    <tr data-version={name}>
      <th scope="row" class="name">
        <a href={linkTo('view', [map, name])}>{name}</a>
        <span class="badges">
          {version.active && <Badge tone="good">Active</Badge>}
          {name === list.previous_version && <Badge tone="plain">Previous</Badge>}
          {failedJob !== undefined && <a class="badge warn" href={linkTo('jobs', [String(failedJob)])}>Checks failed</a>}
          {version.state === 'failed' && <Badge tone="bad">Failed</Badge>}
          {version.state === 'loading' && <Badge tone="live">Loading</Badge>}
        </span>
        {version.failure !== undefined && <span class="fault">{version.failure}</span>}
      </th>
      <td title={date(version.created_ns)}>{age(version.created_ns)}</td>
      <td class="end number">{version.area_m2 === undefined ? '–' : area(version.area_m2)}</td>
      <td class="end number">{version.points === undefined ? '–' : short(version.points)}</td>
      <td class="end number">{bytes(version.bytes)}</td>
      <td class="built">
        <span>{version.drives?.join(', ') ?? '–'}</span>
        <span class="quiet" title={allOptions(version.options)}>{options.length > 0 ? options.join(' · ') : version.options === undefined ? '' : 'default options'}</span>
      </td>
      <td class="end">
        <div class="actions end">
          {list.version !== null && !version.active && (
            <a class="button small" href={linkTo('compare', [map, list.version, name])} aria-label={`Compare ${name} with ${list.version}`}>
              <Icon name="compare" /> Compare
            </a>
          )}
          {list.version !== null && !version.active && (
            <button type="button" class="small" onClick={() => onOpen({ what: 'rollout', version: name })} aria-label={`Roll out ${name}`}>Roll out</button>
          )}
          {!version.active && (
            <button type="button" class="small" onClick={() => onOpen({ what: 'activate', version: name })} aria-label={`Activate ${name}`}>Activate</button>
          )}
          <button type="button" class="plain small" aria-label={`Download ${name} as a tar`} title="Download as a tar" onClick={() => void downloadPackage(map, name)}>
            <Icon name="download" />
          </button>
          <button
            type="button" class="plain small" aria-label={`Delete ${name}`} disabled={version.active}
            title={version.active ? 'The active version cannot be deleted. Activate another one first.' : 'Delete'} onClick={() => onOpen({ what: 'delete', version: name })}
          >
            <Icon name="trash" />
          </button>
        </div>
      </td>
    </tr>
  );
}

function allOptions(options: Record<string, string> | undefined): string {
  return Object.entries(options ?? {}).map(([name, value]) => `${name}: ${value}`).join('\n');
}

/** Chooses any two versions to compare. */
function CompareChoice({ map, list }: { map: string; list: VersionListData }) {
  const names = list.versions.map(({ version }) => version);
  const [first, setFirst] = useState(list.version ?? names[0] ?? '');
  const [second, setSecond] = useState(names.filter((name) => name !== first).at(-1) ?? '');
  const choice = (label: string, value: string, set: (name: string) => void) => (
    <select aria-label={label} value={value} onChange={(event) => set(event.currentTarget.value)}>
      {names.map((name) => <option key={name} value={name}>{name}</option>)}
    </select>
  );
  return (
    <div class="compare-choice">
      {choice('Compare', first, setFirst)}
      <span class="quiet">with</span>
      {choice('with', second, setSecond)}
      {first === second
        ? <button type="button" disabled>Compare</button>
        : <a class="button" href={linkTo('compare', [map, first, second])}><Icon name="compare" /> Compare</a>}
    </div>
  );
}

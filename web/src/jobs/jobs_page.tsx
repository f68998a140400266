import { useEffect, useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { toApiError, type ApiError } from '../api/errors.js';
import { go, linkTo } from '../state/router.js';
import { useLoad } from '../ui/load.js';
import { Empty, Trouble } from '../ui/parts.js';
import { isOver, kStatuses, statusOf, type Job } from './job.js';
import { JobTable } from './job_table.js';

const kEveryS = 3;
const kPage = 25;

/** The jobs, newest first. The filters are part of the address. */
export function JobsPage({ query }: { query: URLSearchParams }) {
  const status = kStatuses.find((one) => one === query.get('status'));
  const map = query.get('map') ?? '';
  const maps = useLoad((signal) => ask('get', '/v1/maps', { signal }), []);
  const filters = { ...(status === undefined ? {} : { status }), ...(map === '' ? {} : { map }) };
  const first = useLoad(async (signal) => {
    const { data } = await ask('get', '/v1/jobs', { query: { ...filters, limit: kPage }, signal });
    return { jobs: data.jobs as Job[], next: data.next };
  }, [status, map], { everyS: kEveryS });
  const older = useOlder(filters, first.data);
  const filterBy = (change: { status?: string; map?: string }): void => {
    const next = { status: status ?? '', map, ...change };
    go(linkTo('jobs', [], Object.fromEntries(Object.entries(next).filter(([, value]) => value !== ''))));
  };
  const jobs = first.data === undefined ? undefined : inOrder(first.data.jobs, older.jobs);
  return (
    <>
      <div class="heading">
        <h1>Jobs</h1>
        <span class="grow" />
        <label class="filter-choice">
          <span>State</span>
          <select value={status ?? ''} onChange={(event) => filterBy({ status: event.currentTarget.value })}>
            <option value="">All</option>
            {kStatuses.map((one) => <option key={one} value={one}>{statusOf({ status: one, cancel_requested: false }).text}</option>)}
          </select>
        </label>
        <label class="filter-choice">
          <span>Map</span>
          <select value={map} onChange={(event) => filterBy({ map: event.currentTarget.value })}>
            <option value="">All</option>
            {[...new Set([...(maps.data?.data.maps.map(({ name }) => name) ?? []), ...(map === '' ? [] : [map])])].map((name) =>
              <option key={name} value={name}>{name}</option>)}
          </select>
        </label>
      </div>
      {first.error !== undefined && <Trouble error={first.error} onRetry={first.reload} />}
      {jobs === undefined && first.loading && <p class="waiting" role="status">Loading the jobs…</p>}
      {jobs !== undefined && (jobs.length > 0 ? <JobTable jobs={jobs} live={jobs.find((job) => !isOver(job))?.id} onEnd={first.reload} />
        : <Empty title={status === undefined && map === '' ? 'No jobs yet' : 'No job matches these filters'}><p>Rebuilds and conversions of maps are listed here while they run and for some days afterwards.</p></Empty>)}
      {older.error !== undefined && <Trouble error={older.error} onRetry={older.more} />}
      {older.next !== null && <p class="more"><button type="button" onClick={older.more}>Show older jobs</button></p>}
    </>
  );
}

/** The newest page and the older jobs. A new job moves the last one of the newest page to the older ones. */
function inOrder(first: readonly Job[], older: readonly Job[]): Job[] {
  const least = first.at(-1)?.id ?? Infinity;
  return [...first, ...older.filter(({ id }) => id < least)];
}

/** The older pages that the person asked for. @param first the newest page, as it is now */
function useOlder(filters: Record<string, string>, first: { jobs: readonly Job[]; next: number | null } | undefined) {
  const [state, setState] = useState<{ jobs: Job[]; next: number | null; error?: ApiError }>({ jobs: [], next: null });
  const what = JSON.stringify(filters);
  useEffect(() => setState({ jobs: [], next: null }), [what]);
  const next = state.jobs.length === 0 ? first?.next ?? null : state.next;
  const more = (): void => {
    if (next === null) return;
    // Those of the first page too: newer jobs may move them out of it.
    const known = state.jobs.length === 0 ? [...first?.jobs ?? []] : state.jobs;
    ask('get', '/v1/jobs', { query: { ...filters, limit: kPage, before: next } }).then(
      ({ data }) => setState({ jobs: [...known, ...(data.jobs as Job[])], next: data.next }),
      (error: unknown) => setState((before) => ({ ...before, error: toApiError(error) })));
  };
  return { ...state, next, more };
}

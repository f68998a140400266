import { useEffect, useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { linkTo } from '../state/router.js';
import { Confirm } from '../ui/confirm.js';
import { date, duration, firstUpper } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { say } from '../ui/notices.js';
import { Badge, Progress, Trouble } from '../ui/parts.js';
import { useJobFeed } from './feed.js';
import { GateVerdict } from './gate.js';
import { isOver, outcomeOf, stageWords, statusOf, timeTaken, type Job } from './job.js';
import { JobLog } from './job_log.js';
import { ReportWhenDone } from './report_when_done.js';

/** One job: progress, log and result. */
export function JobPage({ id }: { id: number }) {
  const { job, error, interrupted, reload } = useJobFeed(id);
  const [asking, setAsking] = useState(false);
  if (job === undefined) {
    return error === undefined ? <p class="waiting" role="status">Loading job {id}…</p>
      : <Trouble error={error} title={`Job ${id}`} onRetry={reload} />;
  }
  const status = statusOf(job);
  return (
    <>
      <div class="heading">
        <a class="button plain" href={linkTo('jobs')} aria-label="Back to all jobs"><Icon name="back" /></a>
        <h1>{job.kind === 'convert' ? 'Conversion' : 'Rebuild'} {id} of <a href={linkTo('maps', [job.map])}>{job.map}</a></h1>
        <Badge tone={status.tone}>{status.text}</Badge>
        <span class="grow" />
        {!isOver(job) && !job.cancel_requested && <button type="button" onClick={() => setAsking(true)}>Cancel the job</button>}
      </div>
      {error !== undefined && <Trouble error={error} onRetry={reload} />}
      <section class="card job-state" aria-label="State" data-status={job.status}>
        {isOver(job) ? <Outcome job={job} /> : <UnderWay job={job} interrupted={interrupted} />}
      </section>
      {job.result?.gate !== undefined && job.result.gate !== null && <GateVerdict gate={job.result.gate} />}
      <Request job={job} />
      <JobLog id={id} over={isOver(job)} />
      {asking && <Cancel id={id} onClose={() => setAsking(false)} onDone={reload} />}
    </>
  );
}

function UnderWay({ job, interrupted }: { job: Job; interrupted: boolean }) {
  // The running time also grows between two events.
  const [, tick] = useState(0);
  useEffect(() => {
    const timer = setInterval(() => tick((count) => count + 1), 1000);
    return () => clearInterval(timer);
  }, []);
  const share = job.status === 'enqueued' ? 0 : job.progress;
  return (
    <>
      <div class="job-line">
        <strong>{job.status === 'enqueued' ? 'Waiting for other jobs' : stageWords(job.stage)}</strong>
        <span class="quiet number">
          {[share === null ? '' : `${Math.floor(100 * share)} %`, timeTaken(job) && `${timeTaken(job)} so far`,
            job.eta_s === null ? '' : `about ${duration(job.eta_s)} left`].filter(Boolean).join(' · ')}
        </span>
      </div>
      <Progress value={share} label={`Progress of job ${job.id}`} />
      {job.attempts > 1 && <p class="remark">Attempt {job.attempts}: {job.error === '' ? 'the attempt before was interrupted.' : job.error}</p>}
      {interrupted && <p class="quiet" role="status">The connection was lost. Trying again…</p>}
      <ReportWhenDone id={job.id} />
    </>
  );
}

function Outcome({ job }: { job: Job }) {
  const version = job.result?.version;
  return (
    <>
      <p class={job.status === 'failed' ? 'fault outcome' : 'outcome'} role="status">{outcomeOf(job)}</p>
      <p class="quiet number">
        {timeTaken(job) && `Took ${timeTaken(job)}. `}{job.finished_ns !== null && `Ended ${date(job.finished_ns)}.`}
      </p>
      {version !== undefined && (
        <div class="actions">
          <a class="button primary" href={linkTo('view', [job.map, version])}><Icon name="eye" /> View {version}</a>
          <a class="button" href={linkTo('maps', [job.map])}>Versions of {job.map}</a>
        </div>
      )}
    </>
  );
}

function Request({ job }: { job: Job }) {
  const request = (job.request ?? {}) as Record<string, unknown>;
  const options = Object.entries((request['options'] ?? {}) as Record<string, unknown>);
  const facts: [string, string][] = [
    ['Requested', date(job.enqueued_ns)],
    ...(job.key_id === '' ? [] : [['Key', job.key_id] as [string, string]]),
    ...Object.entries(request).filter(([name]) => name !== 'options').map(([name, value]): [string, string] => [firstUpper(name.replace(/_/g, ' ')), name === 'drives' || name === 'held_back' ? driveWords(value) : wordsOf(value)]),
    ...options.map(([name, value]): [string, string] => [name, wordsOf(value)]),
  ];
  return (
    <section aria-labelledby="request">
      <h2 id="request">Request</h2>
      <dl class="card facts job-request">
        {facts.map(([term, value]) => <div key={term}><dt>{term}</dt><dd>{value}</dd></div>)}
      </dl>
    </section>
  );
}

/** Numbers of drives as on the map's page. */
function driveWords(value: unknown): string {
  return Array.isArray(value) ? value.map(driveWords).join(', ') : typeof value === 'number' ? `drive ${value}` : wordsOf(value);
}

function wordsOf(value: unknown): string {
  if (Array.isArray(value)) return value.map(wordsOf).join(', ');
  if (typeof value === 'boolean') return value ? 'yes' : 'no';
  return typeof value === 'object' ? JSON.stringify(value) : String(value);
}

function Cancel({ id, onClose, onDone }: { id: number; onClose: () => void; onDone: () => void }) {
  const act = async (): Promise<void> => {
    await ask('post', '/v1/jobs/{job}/cancel', { path: { job: id } });
    say({ kind: 'plain', text: `Job ${id} is stopping.` });
    onDone();
  };
  return (
    <Confirm title={`Cancel job ${id}?`} verb="Cancel the job" danger act={act} onClose={onClose}>
      <p>Its results so far are discarded. Stored maps do not change.</p>
    </Confirm>
  );
}

import { useEffect } from 'preact/hooks';
import { linkTo } from '../state/router.js';
import { age, date, duration } from '../ui/format.js';
import { Badge, Progress } from '../ui/parts.js';
import { useJobFeed } from './feed.js';
import { isOver, outcomeOf, stageWords, statusOf, timeTaken, type Job } from './job.js';

export interface JobTableProps {
  jobs: readonly Job[];
  /** The job that is updated from its event stream. The others are as new as the list: a browser has few connections. */
  live?: number | undefined;
  onEnd: () => void;
  /** All jobs are of one map, whose column is left out. */
  oneMap?: boolean;
}

/** Jobs with state, progress and result. */
export function JobTable({ jobs, live, onEnd, oneMap }: JobTableProps) {
  return (
    <div class="card table-frame">
      <table class="jobs">
        <thead>
          <tr>
            <th scope="col">Job</th>{oneMap !== true && <th scope="col">Map</th>}<th scope="col">State</th>
            <th scope="col" class="wide">Progress and result</th><th scope="col">Requested</th><th scope="col" class="end">Took</th>
          </tr>
        </thead>
        <tbody>
          {jobs.map((job) => job.id === live
            ? <LiveRow key={job.id} job={job} oneMap={oneMap} onEnd={onEnd} />
            : <Row key={job.id} job={job} oneMap={oneMap} />)}
        </tbody>
      </table>
    </div>
  );
}

function LiveRow({ job, oneMap, onEnd }: { job: Job; oneMap: boolean | undefined; onEnd: () => void }) {
  const feed = useJobFeed(job.id);
  const ended = feed.job !== undefined && isOver(feed.job);
  useEffect(() => {
    if (ended) onEnd();
  }, [ended]);
  return <Row job={feed.job ?? job} oneMap={oneMap} />;
}

function Row({ job, oneMap }: { job: Job; oneMap: boolean | undefined }) {
  const status = statusOf(job);
  return (
    <tr data-job={job.id} data-status={job.status}>
      <th scope="row" class="name">
        <a href={linkTo('jobs', [String(job.id)])}>{job.kind === 'convert' ? 'Conversion' : 'Rebuild'} {job.id}</a>
      </th>
      {oneMap !== true && <td><a href={linkTo('maps', [job.map])}>{job.map}</a></td>}
      <td><Badge tone={status.tone}>{status.text}</Badge></td>
      <td>{isOver(job) ? <span class={job.status === 'failed' ? 'fault' : ''}>{outcomeOf(job)}</span> : <Under job={job} />}</td>
      <td title={date(job.enqueued_ns)}>{age(job.enqueued_ns)}</td>
      <td class="end number">{timeTaken(job) || '–'}</td>
    </tr>
  );
}

/** Stage, progress bar and remaining time. */
function Under({ job }: { job: Job }) {
  const share = job.status === 'enqueued' ? 0 : job.progress;
  const left = job.eta_s === null ? '' : ` · ${duration(job.eta_s)} left`;
  return (
    <div class="under">
      <Progress value={share} label={`Progress of job ${job.id}`} />
      <span class="quiet number">
        {job.status === 'enqueued' ? 'Waiting for other jobs' : stageWords(job.stage)}
        {share === null || job.status === 'enqueued' ? '' : ` · ${Math.floor(100 * share)} %`}{left}
      </span>
    </div>
  );
}

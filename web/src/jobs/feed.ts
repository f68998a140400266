import { useEffect, useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { isAborted, toApiError, type ApiError } from '../api/errors.js';
import { follow } from '../api/events.js';
import { isOver, withEvent, type Job } from './job.js';

export interface JobFeed {
  job: Job | undefined;
  /** Why the job cannot be shown; undefined while it can. */
  error: ApiError | undefined;
  /** The stream broke and is tried again. */
  interrupted: boolean;
  reload: () => void;
}

/** A job and its progress, from its event stream while the component is there. */
export function useJobFeed(id: number): JobFeed {
  const [state, setState] = useState<Omit<JobFeed, 'reload'>>({ job: undefined, error: undefined, interrupted: false });
  const [turn, setTurn] = useState(0);
  useEffect(() => {
    const stop = new AbortController();
    const update = (change: Partial<JobFeed>): void => {
      if (!stop.signal.aborted) setState((before) => ({ ...before, ...change }));
    };
    followJob(id, (job) => update({ job, error: undefined }), (interrupted) => update({ interrupted }), stop.signal)
      .catch((error: unknown) => isAborted(error) || update({ error: toApiError(error) }));
    return () => stop.abort();
  }, [id, turn]);
  return { ...state, reload: () => setTurn(turn + 1) };
}

/** Calls `tell` with each state of a job until it ends. @throws ApiError when the job cannot be loaded; AbortError. */
async function followJob(
  id: number, tell: (job: Job) => void, tellInterrupted: (interrupted: boolean) => void, signal: AbortSignal,
): Promise<void> {
  const get = async (): Promise<Job> => (await ask('get', '/v1/jobs/{job}', { path: { job: id }, signal })).data as Job;
  let job = await get();
  tell(job);
  if (isOver(job)) return;
  await follow(`/v1/jobs/${id}/events`, ({ data }) => {
    job = withEvent(job, data);
    tell(job);
    return isOver(job) ? 'stop' : undefined;
  }, { signal, onTrouble: (error) => tellInterrupted(error !== undefined) });
  // Times and result, which are not part of the events.
  tell(await get());
}

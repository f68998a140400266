import { useEffect, useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { isAborted, toApiError, type ApiError } from '../api/errors.js';
import { follow } from '../api/events.js';
import { isOver, withEvent, type Job } from './job.js';

export interface JobFeed {
  job: Job | undefined;
  /** Why there is nothing (any more) to show; undefined as long as there is. */
  error: ApiError | undefined;
  /** The stream broke and is tried again. */
  interrupted: boolean;
  reload: () => void;
}

/** A job as it goes on, told by its event stream as long as the component is there. */
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

/** Tells a job's states until it is over. @throws ApiError when it cannot be had; AbortError. */
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
  // Times and outcome, which the events do not tell.
  tell(await get());
}

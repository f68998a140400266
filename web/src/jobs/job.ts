// Jobs as the page shows them, and their texts.

import type { AnswerOf } from '../api/client.js';
import { duration, firstUpper, toDate } from '../ui/format.js';
import type { Tone } from '../ui/parts.js';

export type Job = Omit<AnswerOf<'/v1/jobs/{job}', 'get'>, 'result'> & { result: JobResult | null };

export interface JobResult {
  version: string;
  activated?: boolean;
  not_activated_because?: string[];
  gate?: Gate | null;
}

/** The quality checks of a rebuilt version (mapping/rebuild.md, "The report"). */
export interface Gate {
  verdict: string;
  reasons?: string[];
  warnings?: string[];
  checks?: { name: string; found: number | null; limit: number; passed: boolean; words: string }[];
  held_back?: { from?: string; every?: number; scans?: number } | null;
}

export const kStatuses = ['enqueued', 'processing', 'succeeded', 'failed', 'canceled'] as const;

const kWords: Record<Job['status'], { tone: Tone; text: string }> = {
  enqueued: { tone: 'plain', text: 'Waiting' },
  processing: { tone: 'live', text: 'Running' },
  succeeded: { tone: 'good', text: 'Succeeded' },
  failed: { tone: 'bad', text: 'Failed' },
  canceled: { tone: 'plain', text: 'Cancelled' },
};

export function statusOf(job: Pick<Job, 'status' | 'cancel_requested'> & { result?: JobResult | null }): { tone: Tone; text: string } {
  if (job.cancel_requested && !isOver(job)) return { tone: 'warn', text: 'Cancelling' };
  if (job.status === 'succeeded' && failedItsChecks(job)) return { tone: 'warn', text: 'Checks failed' };
  return kWords[job.status] ?? { tone: 'plain', text: job.status };
}

/** Whether it built a version that only a person may activate. */
export function failedItsChecks({ result }: { result?: JobResult | null }): boolean {
  return result?.gate?.verdict === 'fail';
}

export function isOver({ status }: Pick<Job, 'status'>): boolean {
  return status === 'succeeded' || status === 'failed' || status === 'canceled';
}

/** "map: survey" as "Map: survey", and the second map of a rebuild, "keep", in words. */
export function stageWords(stage: string): string {
  return firstUpper(stage.replace(/^keep: /, 'map to compare with: '));
}

/** How long it took, or has run so far; empty before it starts. */
export function timeTaken(job: Pick<Job, 'started_ns' | 'finished_ns'>, now: Date = new Date()): string {
  if (job.started_ns === null) return '';
  const end = job.finished_ns === null ? now : toDate(job.finished_ns);
  return duration((end.getTime() - toDate(job.started_ns).getTime()) / 1000);
}

/** The result as one sentence; empty while the job runs. */
export function outcomeOf({ status, error, result, kind }: Pick<Job, 'status' | 'error' | 'result' | 'kind'>): string {
  if (status === 'failed') return error === '' ? 'The job failed. Look at its log.' : error;
  if (status === 'canceled') return 'The job was cancelled. Nothing was stored.';
  if (status !== 'succeeded' || result === null) return '';
  const made = `${result.version} is stored`;
  if (result.activated === true) return `${made} and active.`;
  if (kind === 'convert') return `${made}. Vehicles use it after you activate it.`;
  const because = result.not_activated_because ?? [];
  if (because.length > 0) return `${made}, but not active: ${because.join('; ')}. Compare it with the active version, and activate it if you want it.`;
  return failedItsChecks({ result }) ? `${made}. It did not pass the checks: look at them before you activate it.` : `${made}. You can activate it.`;
}

/** The job after an event of its stream. The event `end` of a server that stops says nothing about the job. */
export function withEvent(job: Job, data: string): Job {
  const news = JSON.parse(data) as Partial<Job>;
  if (news.status === undefined) return job;
  return { ...job, ...news };
}

// Jobs whose end is reported in every view, and as a system notification if the person allowed it.

import { ask } from '../api/client.js';
import { ApiError } from '../api/errors.js';
import { linkTo } from '../state/router.js';
import { say } from '../ui/notices.js';
import { Store } from '../state/store.js';
import { isOver, outcomeOf, type Job } from './job.js';

const kSlot = 'stillmap.watched';
const kEveryMs = 4000;

/** Numbers of the jobs that are watched; kept over a reload. */
export const watched = new Store<readonly number[]>(read());
let timer: ReturnType<typeof setTimeout> | undefined;

function read(): number[] {
  try {
    const list: unknown = JSON.parse(globalThis.sessionStorage?.getItem(kSlot) ?? '[]');
    return Array.isArray(list) ? list.filter((id) => Number.isInteger(id)) : [];
  } catch {
    return [];
  }
}

function set(list: readonly number[]): void {
  watched.set(list);
  try {
    sessionStorage.setItem(kSlot, JSON.stringify(list));
  } catch {
    // Then it lasts until the page is closed.
  }
  startWatching();
}

export function watchJob(id: number): void {
  if (!watched.get().includes(id)) set([...watched.get(), id]);
}

export function unwatchJob(id: number): void {
  set(watched.get().filter((other) => other !== id));
}

/** Checks the watched jobs periodically, while there are any. */
export function startWatching(): void {
  clearTimeout(timer);
  if (watched.get().length === 0) return;
  timer = setTimeout(() => void look().finally(startWatching), kEveryMs);
}

async function look(): Promise<void> {
  for (const id of watched.get()) {
    try {
      const job = (await ask('get', '/v1/jobs/{job}', { path: { job: id }, patience: 0 })).data as Job;
      if (isOver(job)) tell(job);
    } catch (error) {
      if (error instanceof ApiError && error.status === 404) unwatchJob(id);
    }
  }
}

function tell(job: Job): void {
  unwatchJob(job.id);
  const title = `${job.kind === 'convert' ? 'Conversion' : 'Rebuild'} of ${job.map}`;
  const text = outcomeOf(job);
  say({
    kind: job.status === 'succeeded' ? 'good' : 'bad', text: `${title}: ${text}`,
    link: { href: linkTo('jobs', [String(job.id)]), text: `Job ${job.id}` },
  });
  if (canNotify() !== 'granted' || !document.hidden) return;
  const note = new Notification(title, { body: text, tag: `stillmap-job-${job.id}` });
  note.onclick = () => {
    window.focus();
    window.location.hash = linkTo('jobs', [String(job.id)]);
  };
}

/** Whether system notifications are allowed; `none` if the browser has none. */
export function canNotify(): NotificationPermission | 'none' {
  return 'Notification' in globalThis && globalThis.isSecureContext ? Notification.permission : 'none';
}

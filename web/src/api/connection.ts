import { Store } from '../state/store.js';

/**
 * The connection between page and server, from the latest requests. `busy`: the server said when to try again, and the
 * page waits; `slow`: a request has taken long.
 */
export type Connection = { state: 'up' | 'down' | 'slow' } | { state: 'busy'; retryAtMs: number; words: string };

export const connection = new Store<Connection>({ state: 'up' });

const kProbeEveryMs = 2000;
const kSlowMs = 4000;
let probe: ReturnType<typeof setTimeout> | undefined;
let slow = 0;

/** Any answer, whatever its status. */
export function answered(): void {
  clearTimeout(probe);
  probe = undefined;
  if (connection.get().state !== 'up') connection.set({ state: slow > 0 ? 'slow' : 'up' });
}

/** No answer came: asks `/livez` until the server answers, so that the page recovers without the person. */
export function unanswered(): void {
  connection.set({ state: 'down' });
  if (probe !== undefined) return;
  const ask = async (): Promise<void> => {
    try {
      await fetch('/livez', { cache: 'no-store', signal: AbortSignal.timeout(5000) });
      answered();
    } catch {
      probe = setTimeout(() => void ask(), kProbeEveryMs);
    }
  };
  probe = setTimeout(() => void ask(), kProbeEveryMs);
}

/** The server asked to try again later. */
export function busy(retryAfterS: number, words: string): void {
  connection.set({ state: 'busy', retryAtMs: Date.now() + 1000 * retryAfterS, words });
}

/** Starts to watch a request. @return to be called when it ended. */
export function watch(): () => void {
  let counted = false;
  const timer = setTimeout(() => {
    counted = true;
    slow += 1;
    // It also ends `busy`: the request that was sent again after the wait is one that takes long.
    if (connection.get().state !== 'down') connection.set({ state: 'slow' });
  }, kSlowMs);
  return () => {
    clearTimeout(timer);
    if (counted) slow -= 1;
    if (slow === 0 && connection.get().state === 'slow') connection.set({ state: 'up' });
  };
}

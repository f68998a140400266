/** How a map is asked for; what `fetch` does, with whatever key the page has. */
export type Ask = (url: string, init: { signal: AbortSignal }) => Promise<Response>;

/** Why no more tiles come, in words for a person. */
export interface Trouble {
  readonly kind: 'offline' | 'refused' | 'gone' | 'busy';
  readonly text: string;
}

export interface Waiting {
  /** Waits [ms] between the tries of one request that brought no answer; their number bounds the tries. */
  readonly offlineWaitsMs: readonly number[];
  /** Most times that one request is asked again after "try later" (503, 429). */
  readonly busyTries: number;
  /** Longest pause [ms] that a server's Retry-After is followed for. */
  readonly longestPauseMs: number;
}

const kWaiting: Waiting = { offlineWaitsMs: [500, 2000], busyTries: 30, longestPauseMs: 10_000 };

/**
 * Fetches tiles, and stands still when that makes no sense: after a bounded number of tries all requests wait,
 * the picture stays as it is, and one word goes to the person. `retry` goes on with all of them.
 */
export class TileSource {
  private trouble_: Trouble | undefined;
  private held_: (() => void)[] = [];

  /**
   * @param onTrouble told once when requests begin to wait, and with undefined when they go on.
   */
  constructor(
    private readonly ask_: Ask,
    private readonly onTrouble_: (trouble: Trouble | undefined) => void,
    private readonly waiting_: Waiting = kWaiting,
  ) {}

  /** The body; waits as long as there is trouble. Rejects only with AbortError when `signal` fires. */
  async bytes(url: string, signal: AbortSignal): Promise<ArrayBuffer> {
    return this.until(signal, async () => (await this.answer(url, signal)).arrayBuffer());
  }

  /** As `bytes`, parsed. */
  async json(url: string, signal: AbortSignal): Promise<unknown> {
    return this.until(signal, async () => (await this.answer(url, signal)).json() as Promise<unknown>);
  }

  get trouble(): Trouble | undefined {
    return this.trouble_;
  }

  /** Lets all that waits try again. */
  retry(): void {
    if (this.trouble_ === undefined) return;
    this.trouble_ = undefined;
    this.onTrouble_(undefined);
    for (const go of this.held_.splice(0)) go();
  }

  private async until<Body>(signal: AbortSignal, read: () => Promise<Body>): Promise<Body> {
    for (;;) {
      if (this.trouble_ !== undefined) await this.hold(signal);
      try {
        return await read();
      } catch (error) {
        signal.throwIfAborted();
        if (this.trouble_ === undefined) this.begin(error instanceof Refused ? error.trouble : offline());
      }
    }
  }

  private async answer(url: string, signal: AbortSignal): Promise<Response> {
    let busy = 0;
    for (let tries = 0; ;) {
      let response: Response;
      try {
        response = await this.ask_(url, { signal });
      } catch (error) {
        signal.throwIfAborted();
        const wait = this.waiting_.offlineWaitsMs[tries++];
        // While one request has found that nobody answers, the others need not find it too.
        if (wait === undefined || this.trouble_ !== undefined) throw error;
        await pause(wait, signal);
        continue;
      }
      if (response.ok) return response;
      if (response.status !== 503 && response.status !== 429) throw new Refused(await troubleOf(response));
      if (++busy > this.waiting_.busyTries) throw new Refused(await troubleOf(response));
      await pause(Math.min(retryAfterMs(response), this.waiting_.longestPauseMs), signal);
    }
  }

  private begin(trouble: Trouble): void {
    this.trouble_ = trouble;
    this.onTrouble_(trouble);
  }

  private hold(signal: AbortSignal): Promise<void> {
    return new Promise((resolve, reject) => {
      const stop = (): void => reject(signal.reason as Error);
      signal.addEventListener('abort', stop, { once: true });
      this.held_.push(() => {
        signal.removeEventListener('abort', stop);
        resolve();
      });
    });
  }
}

class Refused extends Error {
  constructor(readonly trouble: Trouble) {
    super(trouble.text);
  }
}

function offline(): Trouble {
  return { kind: 'offline', text: 'The server does not answer. What is shown stays; the rest comes when it is back.' };
}

async function troubleOf(response: Response): Promise<Trouble> {
  const problem = (await response.json().catch(() => ({}))) as { title?: unknown; detail?: unknown };
  const said = [problem.title, problem.detail].filter((text) => typeof text === 'string').join(': ');
  const why = said === '' ? `status ${response.status}` : said;
  if (response.status === 404 || response.status === 410) {
    return { kind: 'gone', text: `This version of the map is no longer on the server (${why}). What is shown stays until you leave.` };
  }
  if (response.status === 503 || response.status === 429) {
    return { kind: 'busy', text: `The server is too busy to send more of the map (${why}).` };
  }
  return { kind: 'refused', text: `The server refuses to send more of the map (${why}).` };
}

/** RFC 9110 10.2.3: seconds, or a date; 1 s when it says nothing. */
function retryAfterMs(response: Response): number {
  const text = response.headers.get('retry-after');
  const value = text === null ? NaN : /^\d+$/.test(text) ? 1000 * Number(text) : Date.parse(text) - Date.now();
  return Number.isFinite(value) ? Math.max(value, 100) : 1000;
}

function pause(ms: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    const stop = (): void => {
      clearTimeout(timer);
      reject(signal.reason as Error);
    };
    const timer = setTimeout(() => {
      signal.removeEventListener('abort', stop);
      resolve();
    }, ms);
    signal.addEventListener('abort', stop, { once: true });
  });
}

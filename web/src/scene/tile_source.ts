import { toApiError, type ApiError } from '../api/errors.js';

/** Sends a request; throws ApiError unless it succeeds. It also waits for a busy server. */
export type Ask = (url: string, init: { readonly signal: AbortSignal }) => Promise<Response>;

/** Why no more tiles arrive; the text is for people. */
export interface Trouble {
  readonly kind: 'offline' | 'gone' | 'busy' | 'key' | 'refused';
  readonly text: string;
}

/** Whether it ends when the server answers again or the key changes. */
export function isPassing(trouble: Trouble | undefined): boolean {
  return trouble?.kind === 'offline' || trouble?.kind === 'busy' || trouble?.kind === 'key';
}

/** Waits [ms] between the attempts of a request without an answer; their number limits the attempts. */
const kWaitsMs: readonly number[] = [500, 2000];

/**
 * Loads tiles, and pauses when that cannot succeed: after a limited number of attempts all requests wait, the picture
 * stays, and the person gets one message. `retry` continues all requests.
 */
export class TileSource {
  private trouble_: Trouble | undefined;
  private held_: (() => void)[] = [];

  /** @param onTrouble called once when requests start to wait, and with undefined when they continue. */
  constructor(
    private readonly ask_: Ask,
    private readonly onTrouble_: (trouble: Trouble | undefined) => void,
    private readonly waitsMs_: readonly number[] = kWaitsMs,
  ) {}

  /** The body; waits while requests are paused. Rejects only with AbortError, when `signal` fires. */
  bytes(url: string, signal: AbortSignal): Promise<ArrayBuffer> {
    return this.until(signal, async () => (await this.ask_(url, { signal })).arrayBuffer());
  }

  /** As `bytes`, parsed. */
  json(url: string, signal: AbortSignal): Promise<unknown> {
    return this.until(signal, async () => (await this.ask_(url, { signal })).json() as Promise<unknown>);
  }

  get trouble(): Trouble | undefined {
    return this.trouble_;
  }

  /** Lets all waiting requests try again. */
  retry(): void {
    if (this.trouble_ === undefined) return;
    this.trouble_ = undefined;
    this.onTrouble_(undefined);
    for (const go of this.held_.splice(0)) go();
  }

  private async until<Body>(signal: AbortSignal, read: () => Promise<Body>): Promise<Body> {
    for (let tries = 0; ;) {
      if (this.trouble_ !== undefined) {
        await hold(signal, (go) => this.held_.push(go));
        tries = 0;
      }
      try {
        return await read();
      } catch (error) {
        signal.throwIfAborted();
        const refused = toApiError(error);
        const wait = refused.trouble === 'problem' || refused.trouble === 'key' ? undefined : this.waitsMs_[tries++];
        // When one request has found that the server is down, the others wait too.
        if (this.trouble_ !== undefined) continue;
        if (wait === undefined) this.begin(troubleOf(refused));
        else await hold(signal, (go) => setTimeout(go, wait));
      }
    }
  }

  private begin(trouble: Trouble): void {
    this.trouble_ = trouble;
    this.onTrouble_(trouble);
  }
}

function troubleOf(error: ApiError): Trouble {
  if (error.status === 404 || error.status === 410) {
    return { kind: 'gone', text: `This version was deleted from the server. The picture stays until you leave this view. ${error.message}` };
  }
  if (error.status === 503 || error.status === 429) {
    return { kind: 'busy', text: `The server sends no more tiles at the moment. ${error.message}` };
  }
  if (error.trouble === 'key') return { kind: 'key', text: `${error.message} The picture stays.` };
  if (error.trouble === 'problem') return { kind: 'refused', text: error.message };
  return { kind: 'offline', text: `${error.message} The picture stays; the missing tiles are loaded when the server answers.` };
}

// Waits until it is released, or the signal fires.
function hold(signal: AbortSignal, begin: (go: () => void) => void): Promise<void> {
  return new Promise((resolve, reject) => {
    const stop = (): void => reject(signal.reason as Error);
    signal.addEventListener('abort', stop, { once: true });
    begin(() => {
      signal.removeEventListener('abort', stop);
      resolve();
    });
  });
}

import { connection } from '../api/connection.js';
import { ApiError, isAborted, toApiError } from '../api/errors.js';
import { Store } from '../state/store.js';
import { contentDigest, hex, sha256 } from './digest.js';
import { cut, missing, partBytesOf, Speed, type ListedPart, type PartRange } from './parts.js';
import type { Outcome, Target } from './target.js';

/** `comparing`: with the parts that the server has; `waiting`: until the server answers; `checking`: the server checks the whole. */
export type TransferState =
  | 'starting' | 'comparing' | 'sending' | 'waiting' | 'paused' | 'checking' | 'done' | 'failed' | 'canceled';

export interface TransferView {
  state: TransferState;
  bytes: number;
  /** Bytes that have arrived or are being sent. */
  sent: number;
  bytesPerS: number | undefined;
  etaS: number | undefined;
  error: ApiError | undefined;
  outcome: Outcome | undefined;
}

const kPartsAtOnce = 3;

/** True while leaving the page would interrupt it. */
export function isUnderWay(state: TransferState): boolean {
  return !['done', 'failed', 'canceled', 'paused'].includes(state);
}

/** Sends one file in parts. It survives interruptions by the network, the server and the person. */
export class Transfer {
  readonly view: Store<TransferView>;
  private stop_ = new AbortController();
  private readonly speed_ = new Speed();
  /** Bytes that are being sent, by part. */
  private readonly moving_ = new Map<number, number>();
  /** Parts of the server that are known to equal the file. */
  private readonly compared_ = new Set<number>();
  private arrived_ = 0;

  constructor(private readonly content_: Blob, private readonly target_: Target) {
    this.view = new Store<TransferView>({
      state: 'starting', bytes: content_.size, sent: 0, bytesPerS: undefined, etaS: undefined, error: undefined,
      outcome: undefined,
    });
  }

  /** Sends until it is done, fails or is paused; `view` shows the state. */
  async run(): Promise<void> {
    this.stop_ = new AbortController();
    const { signal } = this.stop_;
    for (;;) {
      try {
        this.show({ state: 'starting', error: undefined });
        await this.sendMissing(await this.target_.begin(signal), signal);
        // A part that was being sent during the pause may have arrived.
        signal.throwIfAborted();
        this.show({ state: 'checking', bytesPerS: undefined, etaS: undefined });
        const outcome = await this.target_.finish(signal);
        this.show({ state: 'done', sent: this.content_.size, outcome });
        return;
      } catch (error) {
        if (isAborted(error) || signal.aborted) return;
        const known = toApiError(error);
        const isAway = known.trouble === 'down' || known.trouble === 'late';
        this.show({ state: isAway ? 'waiting' : 'failed', error: known, bytesPerS: undefined, etaS: undefined });
        if (!isAway) return;
        await untilUp(signal).catch(() => undefined);
        if (signal.aborted) return;
      }
    }
  }

  pause(): void {
    this.halt();
    this.show({ state: 'paused', bytesPerS: undefined, etaS: undefined });
  }

  /** Ends the upload and deletes its parts on the server. @throws ApiError when the server cannot be reached. */
  async cancel(): Promise<void> {
    this.halt();
    this.show({ state: 'canceled', bytesPerS: undefined, etaS: undefined });
    await this.target_.discard();
  }

  private halt(): void {
    this.stop_.abort();
    this.moving_.clear();
    this.speed_.reset();
  }

  private async sendMissing(listed: ListedPart[], signal: AbortSignal): Promise<void> {
    const partBytes = partBytesOf(listed, this.content_.size);
    if (partBytes === undefined) throw otherFile();
    const parts = cut(this.content_.size, partBytes);
    await this.compare(parts, listed, signal);
    signal.throwIfAborted();
    this.arrived_ = listed.reduce((sum, { bytes }) => sum + bytes, 0);
    this.moving_.clear();
    this.speed_.reset();
    this.show({ state: 'sending', sent: this.arrived_ });
    await forEachAtOnce(missing(parts, listed), kPartsAtOnce, (part) => this.sendPart(part, signal));
  }

  /** Checks that the server's parts are of this file. @throws ApiError if not. */
  private async compare(parts: readonly PartRange[], listed: readonly ListedPart[], signal: AbortSignal): Promise<void> {
    const unknown = listed.filter(({ n }) => !this.compared_.has(n));
    if (unknown.length > 0) this.show({ state: 'comparing' });
    for (const { n, sha256: expected } of unknown) {
      signal.throwIfAborted();
      const part = parts[n - 1];
      if (part === undefined) throw otherFile();
      const sum = await sha256(await this.read(part));
      if (sum !== undefined && hex(sum) !== expected) throw otherFile();
      this.compared_.add(n);
    }
  }

  private async sendPart(part: PartRange, signal: AbortSignal): Promise<void> {
    const body = await this.read(part);
    const sum = await sha256(body);
    signal.throwIfAborted();
    const digest = sum === undefined ? undefined : contentDigest(sum);
    await this.target_.put(part.n, body, digest, (bytes) => this.moved(part.n, bytes), signal);
    this.compared_.add(part.n);
    this.moving_.delete(part.n);
    this.arrived_ += body.byteLength;
    this.moved();
  }

  private async read({ begin, end }: PartRange): Promise<ArrayBuffer> {
    try {
      return await this.content_.slice(begin, end).arrayBuffer();
    } catch {
      throw new ApiError('garbled', 'The file can no longer be read: it was changed, moved or deleted. Choose it again.');
    }
  }

  private moved(n?: number, bytes = 0): void {
    if (n !== undefined) this.moving_.set(n, bytes);
    const sent = Math.min(this.content_.size, [...this.moving_.values()].reduce((sum, part) => sum + part, this.arrived_));
    this.speed_.note(Date.now(), sent);
    const bytesPerS = this.speed_.bytesPerS;
    const etaS = bytesPerS === undefined || bytesPerS === 0 ? undefined : (this.content_.size - sent) / bytesPerS;
    this.show({ sent, bytesPerS, etaS });
  }

  private show(change: Partial<TransferView>): void {
    this.view.set({ ...this.view.get(), ...change });
  }
}

function otherFile(): ApiError {
  return new ApiError('problem', 'The server has parts of another file for this upload. Choose the file that the upload was '
    + 'started with, or discard the upload and start again.');
}

/** Calls `act` for each item, several at a time. After an error no more are started; it is thrown when all have ended. */
async function forEachAtOnce<Item>(items: readonly Item[], atOnce: number, act: (item: Item) => Promise<void>): Promise<void> {
  const rest = [...items];
  let failed = false;
  const worker = async (): Promise<void> => {
    for (let item = rest.shift(); item !== undefined && !failed; item = rest.shift()) {
      await act(item).catch((error: unknown) => {
        failed = true;
        throw error;
      });
    }
  };
  const ends = await Promise.allSettled(Array.from({ length: Math.min(atOnce, items.length) }, worker));
  const bad = ends.find((end) => end.status === 'rejected');
  if (bad !== undefined) throw bad.reason;
}

function untilUp(signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    // A late answer does not mean that the server is down: then a short wait is enough.
    const timer = connection.get().state === 'down' ? undefined : setTimeout(() => end(resolve), 2000);
    const unlisten = connection.listen(({ state }) => state !== 'down' && end(resolve));
    const aborted = (): void => end(() => reject(signal.reason));
    const end = (how: () => void): void => {
      clearTimeout(timer);
      unlisten();
      signal.removeEventListener('abort', aborted);
      how();
    };
    signal.addEventListener('abort', aborted);
  });
}


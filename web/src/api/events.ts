import { isAborted, toApiError, type ApiError } from './errors.js';
import { send, sleep } from './send.js';
import { SseParser, type ServerEvent } from './sse.js';

export type { ServerEvent } from './sse.js';

export interface FollowOptions {
  signal: AbortSignal;
  /** The first request asks for the events after this one. */
  lastEventId?: string;
  /** Called with undefined when the stream is open, and with the reason when it broke and is tried again. */
  onTrouble?: (error: ApiError | undefined) => void;
}

const kFirstWaitS = 0.5;
const kLongestWaitS = 15;
/** The server sends comments in between; a stream that is silent for longer is dead. */
const kSilenceMs = 60_000;

/**
 * Follows an event stream until it ends for good, over interruptions and with the key in a header, which the browser's
 * own EventSource cannot send.
 *
 * @param on takes each event; `'stop'` ends it. It also ends when the server answers 204.
 * @throws ApiError when there is nothing (any more) to follow, as 404; AbortError when `signal` fires.
 */
export async function follow(
  path: string, on: (event: ServerEvent) => 'stop' | void, options: FollowOptions,
): Promise<void> {
  let lastEventId = options.lastEventId ?? '';
  let waitS = kFirstWaitS;
  const seen = (event: ServerEvent): 'stop' | void => {
    lastEventId = event.id;
    waitS = kFirstWaitS;
    return on(event);
  };
  for (;;) {
    try {
      const headers = { Accept: 'text/event-stream', ...(lastEventId === '' ? {} : { 'Last-Event-ID': lastEventId }) };
      const response = await send('GET', path, { headers, signal: options.signal });
      if (response.status === 204 || response.body === null) return;
      options.onTrouble?.(undefined);
      if (await read(response.body, seen, options.signal)) return;
    } catch (error) {
      if (isAborted(error) || options.signal.aborted) throw error;
      const known = toApiError(error);
      // 429: this key has as many streams as it may have; one of them will end.
      const isRefused = known.status !== undefined && known.status < 500 && known.status !== 429;
      if (known.trouble === 'key' || isRefused) throw known;
      options.onTrouble?.(known);
    }
    await sleep(waitS, options.signal);
    waitS = Math.min(2 * waitS, kLongestWaitS);
  }
}

/** @return whether `on` asked to stop; false when the stream ended or broke. */
async function read(
  body: ReadableStream<Uint8Array>, on: (event: ServerEvent) => 'stop' | void, signal: AbortSignal,
): Promise<boolean> {
  const parser = new SseParser();
  const decoder = new TextDecoder();
  const reader = body.getReader();
  try {
    for (;;) {
      const piece = await withinSilence(reader.read());
      if (piece === undefined || piece.done) return false;
      for (const event of parser.push(decoder.decode(piece.value, { stream: true }))) {
        if (on(event) === 'stop') return true;
      }
    }
  } catch (error) {
    if (signal.aborted) throw error;
    return false;
  } finally {
    reader.cancel().catch(() => undefined);
  }
}

/** @return undefined if nothing came in time. */
async function withinSilence<Value>(promise: Promise<Value>): Promise<Value | undefined> {
  let timer: ReturnType<typeof setTimeout> | undefined;
  const silence = new Promise<undefined>((resolve) => {
    timer = setTimeout(() => resolve(undefined), kSilenceMs);
  });
  try {
    return await Promise.race([promise, silence]);
  } finally {
    clearTimeout(timer);
  }
}

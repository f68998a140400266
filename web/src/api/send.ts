// Sends one request: with the key and a time limit, and again later if the server asks for that.

import { answered, busy, unanswered, watch } from './connection.js';
import { ApiError, down, late, parseProblem, refusal } from './errors.js';
import { fetchWithProgress } from './fetch_with_progress.js';
import { key, keyInForce, needKey, type KeyReason } from './keys.js';

export interface SendOptions {
  headers?: Record<string, string>;
  body?: BodyInit;
  signal?: AbortSignal;
  /** Until the head of the answer [s]. */
  timeoutS?: number;
  /** Called with the number of bytes sent. The time limit counts from the last progress. */
  onProgress?: (sentBytes: number) => void;
  /** How often a request is sent again after a refusal with `Retry-After`; 0 = never. */
  patience?: number;
}

const kTimeoutS = 30;
const kPatience = 5;
const kLongestWaitS = 30;

/**
 * Sends one request and returns its answer if that is a success or 304.
 *
 * After a 401 it opens the key dialog and sends the request again with the new key. After a 429 or 503 with `Retry-After`
 * it waits and sends the request again.
 * @param path of the same origin, as `/v1/maps`.
 * @throws ApiError; AbortError when `signal` fires.
 */
export async function send(method: string, path: string, options: SendOptions = {}): Promise<Response> {
  const where = `${method} ${path}`;
  let patience = options.patience ?? kPatience;
  for (;;) {
    if (path.startsWith('/v1/')) await keyInForce(options.signal);
    const tried = key.get();
    const response = await once(method, path, options, tried);
    if (response.ok || response.status === 304) return response;
    const document = parseProblem(response.headers.get('content-type') ?? '', await textOf(response));
    if (response.status === 401) {
      await needKey(tried, (document?.code as KeyReason | undefined) ?? 'RefusedKey', options.signal);
      continue;
    }
    const error = refusal(where, response.status, document);
    const wait = retryAfter(response);
    if (wait === undefined || patience <= 0) throw error;
    // A derived file that is being made is waited for without a limit.
    if (document?.code !== 'BeingMade') --patience;
    busy(wait, error.message);
    await sleep(wait, options.signal);
  }
}

async function once(method: string, path: string, options: SendOptions, tried: string | undefined): Promise<Response> {
  options.signal?.throwIfAborted();
  const seconds = options.timeoutS ?? kTimeoutS;
  const stop = new AbortController();
  let timedOut = false;
  const expire = (): void => {
    timedOut = true;
    stop.abort();
  };
  let timer = setTimeout(expire, 1000 * seconds);
  const moved = (sentBytes: number): void => {
    clearTimeout(timer);
    timer = setTimeout(expire, 1000 * seconds);
    options.onProgress?.(sentBytes);
  };
  const giveUp = (): void => stop.abort();
  options.signal?.addEventListener('abort', giveUp, { once: true });
  // An upload that takes long does not mean that the server is slow.
  const done = options.onProgress === undefined ? watch() : (): void => undefined;
  try {
    const headers = { ...options.headers, ...(tried === undefined ? {} : { Authorization: `Bearer ${tried}` }) };
    const request = { method, headers, signal: stop.signal, ...(options.body === undefined ? {} : { body: options.body }) };
    const response = await (options.onProgress === undefined ? fetch(path, request) : fetchWithProgress(path, request, moved));
    answered();
    // The caller's signal stays connected, since it must also abort the body.
    return response;
  } catch {
    options.signal?.removeEventListener('abort', giveUp);
    options.signal?.throwIfAborted();
    if (timedOut) throw late(seconds);
    unanswered();
    throw down();
  } finally {
    clearTimeout(timer);
    done();
  }
}

/** The answer's JSON. @throws ApiError when it is not JSON or incomplete. */
export async function jsonOf(response: Response, where: string): Promise<unknown> {
  try {
    return await response.json();
  } catch (error) {
    if (error instanceof DOMException && error.name === 'AbortError') throw error;
    const how = error instanceof SyntaxError ? 'is not JSON' : 'is incomplete';
    throw new ApiError('garbled', `The answer to ${where} ${how}. Reload the page. If that does not help, check the proxy in front of the server.`, { status: response.status });
  }
}

/** Seconds to wait; undefined if the answer does not ask to try again soon. */
function retryAfter(response: Response): number | undefined {
  if (response.status !== 429 && response.status !== 503) return undefined;
  const seconds = Number(response.headers.get('retry-after') ?? Number.NaN);
  return seconds >= 0 && seconds <= kLongestWaitS ? Math.max(seconds, 0.2) : undefined;
}

async function textOf(response: Response): Promise<string> {
  try {
    return await response.text();
  } catch {
    return '';
  }
}

/** @throws AbortError when `signal` fires first. */
export function sleep(seconds: number, signal?: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    const stopped = (): void => {
      clearTimeout(timer);
      reject(signal?.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener('abort', stopped);
      resolve();
    }, 1000 * seconds);
    if (signal?.aborted === true) stopped();
    else signal?.addEventListener('abort', stopped, { once: true });
  });
}

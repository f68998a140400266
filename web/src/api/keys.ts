import { Store } from '../state/store.js';
import { ApiError } from './errors.js';

/** Why a key is asked for: the problem's code, `MissingKey` or `RefusedKey`, or that the person wants another one. */
export type KeyReason = 'MissingKey' | 'RefusedKey' | 'Chosen';

const kSlot = 'stillmap.key';

/** Where the key is kept over a reload: as long as the tab is open, and for this tab only. */
function kept(): Storage | undefined {
  try {
    return globalThis.sessionStorage;
  } catch {
    return undefined;
  }
}

/** The key that every request carries; undefined without one. */
export const key = new Store<string | undefined>(kept()?.getItem(kSlot) ?? undefined);

/** Set while the dialog should be open. */
export const keyWanted = new Store<KeyReason | undefined>(undefined);

interface Waiting {
  readonly resolve: () => void;
  readonly reject: (error: unknown) => void;
}
const waiting = new Set<Waiting>();
/** Why the server refused the present key; a request with it would be refused again. */
let refused: KeyReason | undefined;
/** The person closed the dialog: only the person opens it again. */
let declined = false;

export function setKey(text: string | undefined): void {
  if (text === undefined) kept()?.removeItem(kSlot);
  else kept()?.setItem(kSlot, text);
  refused = undefined;
  declined = false;
  key.set(text);
}

/**
 * Asks the person for a key and waits for it; requests that wait at the same time share one dialog.
 *
 * @param tried the key that was refused, undefined for none. If there is another key by now, that one is used.
 * @throws ApiError of kind `key` when the person closes the dialog, or closed it before and has not opened it since;
 *         AbortError when `signal` fires.
 */
export function needKey(tried: string | undefined, reason: KeyReason, signal?: AbortSignal): Promise<void> {
  if (key.get() !== tried) return Promise.resolve();
  refused = reason;
  return untilGiven(reason, signal);
}

/** Waits while the present key is known to be refused, so that no request is sent in vain. @throws as needKey */
export function keyInForce(signal?: AbortSignal): Promise<void> {
  return refused === undefined ? Promise.resolve() : untilGiven(refused, signal);
}

function untilGiven(reason: KeyReason, signal: AbortSignal | undefined): Promise<void> {
  if (declined) return Promise.reject(noKey());
  keyWanted.set(reason);
  return new Promise((resolve, reject) => {
    const end = (): boolean => waiting.delete(one);
    const stop = (): void => void (end() && reject(signal?.reason));
    const one: Waiting = { resolve, reject };
    waiting.add(one);
    signal?.addEventListener('abort', stop, { once: true });
  });
}

/** Opens the dialog because the person wants it, also after it was closed. */
export function askForKey(): void {
  declined = false;
  keyWanted.set(refused ?? 'Chosen');
}

/** The dialog's answer. @param text the key; undefined when it was closed. */
export function answerKey(text: string | undefined): void {
  if (text !== undefined) setKey(text);
  else declined = refused !== undefined || key.get() === undefined;
  keyWanted.set(undefined);
  const all = [...waiting];
  waiting.clear();
  for (const { resolve, reject } of all) {
    if (text !== undefined) resolve();
    else reject(noKey());
  }
}

function noKey(): ApiError {
  const why = refused === 'RefusedKey' ? 'The server does not accept the API key: it is unknown, revoked or expired. Enter another key.'
    : 'This needs an API key. Enter one.';
  return new ApiError('key', why, { status: 401 });
}

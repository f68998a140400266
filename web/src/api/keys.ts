import { Store } from '../ui/store.js';
import { ApiError } from './errors.js';

/** Why a key is asked for: the problem's code, `MissingKey` or `RefusedKey`, or that the person wants another one. */
export type KeyReason = 'MissingKey' | 'RefusedKey' | 'Chosen';

const kSlot = 'stillmap.key';

/** Where the key lies between reloads: as long as the tab, and in no other one. */
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

let waiting: { resolve: () => void; reject: (error: ApiError) => void }[] = [];

export function setKey(text: string | undefined): void {
  if (text === undefined) kept()?.removeItem(kSlot);
  else kept()?.setItem(kSlot, text);
  key.set(text);
}

/**
 * Asks the person for a key and waits for it; requests that wait at the same time share one dialog.
 *
 * @param tried the key that was refused, undefined for none. When another one is there by now, that one is used.
 * @throws ApiError of kind `key` when the person closes the dialog.
 */
export function needKey(tried: string | undefined, reason: KeyReason): Promise<void> {
  if (key.get() !== tried) return Promise.resolve();
  keyWanted.set(reason);
  return new Promise((resolve, reject) => waiting.push({ resolve, reject }));
}

/** The dialog's answer. @param text the key; undefined when it was closed. */
export function answerKey(text: string | undefined): void {
  if (text !== undefined) setKey(text);
  keyWanted.set(undefined);
  const all = waiting;
  waiting = [];
  for (const one of all) {
    if (text !== undefined) one.resolve();
    else one.reject(new ApiError('key', 'This needs an API key, and none was given.', { status: 401 }));
  }
}

import { connection } from './connection.js';
import { key } from './keys.js';

/** Calls `again` when a failed request may now succeed: the server answers again, or the key has changed. @return stops it. */
export function onRecovery(again: () => void): () => void {
  const ends = [connection.listen(({ state }) => state === 'up' && again()), key.listen(() => again())];
  return () => ends.forEach((end) => end());
}

import { connection } from './connection.js';
import { key } from './keys.js';

/** Calls `again` whenever there is reason to ask anew: the server answers again, or another key is in use. @return ends it. */
export function onRecovery(again: () => void): () => void {
  const ends = [connection.listen(({ state }) => state === 'up' && again()), key.listen(() => again())];
  return () => ends.forEach((end) => end());
}

import { answered } from './connection.js';
import { key, needKey, type KeyReason } from './keys.js';

/**
 * `fetch` with the page's key, for what streams on its own (tiles): refusals come back as answers, and only a 401
 * is dealt with here, by asking the person for a key and going on with it.
 *
 * @throws ApiError of kind `key` when the person gives none; what `fetch` throws else.
 */
export async function askTiles(url: string, init: { signal: AbortSignal }): Promise<Response> {
  for (;;) {
    const tried = key.get();
    const headers = tried === undefined ? {} : { Authorization: `Bearer ${tried}` };
    const response = await fetch(url, { ...init, headers });
    answered();
    if (response.status !== 401) return response;
    const problem = (await response.json().catch(() => ({}))) as { code?: KeyReason };
    await needKey(tried, problem.code ?? 'RefusedKey');
  }
}

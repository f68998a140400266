import { versionPath } from '../api/client.js';
import { toApiError } from '../api/errors.js';
import { key } from '../api/keys.js';
import { send } from '../api/send.js';
import { say } from '../ui/notices.js';
import { saveAddress, saveBlob } from '../ui/save.js';

/** Saves a version's package as a file. Without a key the browser itself streams it to disk. */
export async function downloadPackage(map: string, version: string): Promise<void> {
  const path = `${versionPath(map, version)}/content`;
  const name = `${map}-${version}.tar`;
  if (key.get() === undefined) return saveAddress(path, name);
  try {
    say({ kind: 'plain', text: `Downloading ${name}…` });
    saveBlob(await (await send('GET', path)).blob(), name);
  } catch (error) {
    say({ kind: 'bad', text: `${name}: ${toApiError(error).message}` });
  }
}

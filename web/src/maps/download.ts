import { toApiError } from '../api/errors.js';
import { key } from '../api/keys.js';
import { send } from '../api/send.js';
import { say } from '../ui/notices.js';

/** Saves a version's package as a file. Without a key the browser streams it by itself. */
export async function downloadPackage(map: string, version: string): Promise<void> {
  const path = `/v1/maps/${encodeURIComponent(map)}/versions/${encodeURIComponent(version)}/content`;
  const name = `${map}-${version}.tar`;
  if (key.get() === undefined) return save(path, name);
  try {
    say({ kind: 'plain', text: `Fetching ${name}…` });
    const address = URL.createObjectURL(await (await send('GET', path)).blob());
    save(address, name);
    setTimeout(() => URL.revokeObjectURL(address), 60_000);
  } catch (error) {
    say({ kind: 'bad', text: `${name}: ${toApiError(error).message}` });
  }
}

function save(address: string, name: string): void {
  const link = document.createElement('a');
  link.href = address;
  link.download = name;
  link.click();
}

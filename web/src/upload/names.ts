// Names of maps and versions, by the server's rules.

const kName = /^[a-z0-9][a-z0-9._-]{0,62}$/;

/** Why a text is not a valid name of a map or version; undefined if it is valid. */
export function faultOfName(name: string): string | undefined {
  if (kName.test(name)) return undefined;
  if (name === '') return 'Enter a name.';
  if (name.length > 63) return 'Use at most 63 characters.';
  if (/[A-Z]/.test(name)) return 'Use lower-case letters: a to z, 0 to 9, and . _ - after the first character.';
  return 'Use a to z, 0 to 9, and . _ - after the first character.';
}

/** A name for a map, made from a file name. */
export function suggestedMap(file: string): string {
  const bare = file.replace(/(\.(tar|tgz|gz|zst|zstd|pcd|ply|las|mcap|db3|bag|pcap|pcapng|rawlog))+$/i, '').toLowerCase();
  return bare.replace(/[^a-z0-9._-]+/g, '-').replace(/^[^a-z0-9]+|[-._]+$/g, '').slice(0, 63) || 'map';
}

/** The next free name of v1, v2, ... */
export function suggestedVersion(taken: readonly string[]): string {
  const numbers = taken.map((name) => Number(/^v(\d+)$/.exec(name)?.[1] ?? 0));
  return `v${Math.max(0, ...numbers) + 1}`;
}

// Names of maps and versions, as the server takes them.

const kName = /^[a-z0-9][a-z0-9._-]{0,62}$/;

/** Why it is no name of a map or version, in words; undefined when it is one. */
export function faultOfName(name: string): string | undefined {
  if (kName.test(name)) return undefined;
  if (name === '') return 'A name is needed.';
  if (name.length > 63) return 'At most 63 letters.';
  if (/[A-Z]/.test(name)) return 'Small letters only: a to z, 0 to 9, and . _ - after the first.';
  return 'Letters a to z, digits 0 to 9, and . _ - after the first.';
}

/** A map's name made of a file's. */
export function suggestedMap(file: string): string {
  const bare = file.replace(/(\.(tar|tgz|gz|zst|zstd|pcd|ply|las))+$/i, '').toLowerCase();
  return bare.replace(/[^a-z0-9._-]+/g, '-').replace(/^[^a-z0-9]+|[-._]+$/g, '').slice(0, 63) || 'map';
}

/** The next of v1, v2, ... that is free. */
export function suggestedVersion(taken: readonly string[]): string {
  const numbers = taken.map((name) => Number(/^v(\d+)$/.exec(name)?.[1] ?? 0));
  return `v${Math.max(0, ...numbers) + 1}`;
}

// What a person chooses for a rebuild, and the request that it makes.

export interface RebuildChoices {
  drives: number[];
  /** The drive that the map is judged by; null = some scans of the others. */
  heldBack: number | null;
  /** Only what differs from the mapper's defaults. */
  options: Record<string, string>;
  version: string;
  activate: boolean;
  newFrame: boolean;
}

export const kNoChoices: RebuildChoices = { drives: [], heldBack: null, options: {}, version: '', activate: false, newFrame: false };

/** Options of the mapper that are numbers, not words. */
const kNumbers = new Set(['voxel', 'sensor-height']);

/** @param drives those that are there: one that was deleted since it was chosen is left out. */
export function requestOf(choices: RebuildChoices, drives: readonly { id: number }[]): Record<string, unknown> {
  const options = Object.fromEntries(Object.entries(choices.options).filter(([, value]) => value !== '')
    .map(([name, value]) => [name, kNumbers.has(name) ? Number(value) : value]));
  return {
    drives: drives.map(({ id }) => id).filter((id) => choices.drives.includes(id) && id !== choices.heldBack),
    ...(choices.heldBack === null ? {} : { held_back: choices.heldBack }),
    ...(Object.keys(options).length === 0 ? {} : { options }),
    ...(choices.version === '' ? {} : { version: choices.version }),
    ...(choices.activate ? { activate: true } : {}),
    ...(choices.newFrame ? { new_frame: true } : {}),
  };
}

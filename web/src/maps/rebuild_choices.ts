// The choices for a rebuild, and the request made from them.

export interface RebuildChoices {
  drives: number[];
  /** The drive that the map is checked with; null = some scans of the other drives. */
  heldBack: number | null;
  /** Only those that differ from the mapper's defaults. */
  options: Record<string, string>;
  version: string;
  activate: boolean;
  newFrame: boolean;
}

export const kNoChoices: RebuildChoices = { drives: [], heldBack: null, options: {}, version: '', activate: false, newFrame: false };

/** Options of the mapper that are numbers. */
const kNumbers = new Set(['voxel', 'sensor-height']);

/** @param drives that exist: one that was deleted after it was chosen is left out. */
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

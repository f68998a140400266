// Rows of the lists of maps and versions, and their texts.

import type { AnswerOf, Schema } from '../api/client.js';
import type { Tone } from '../ui/parts.js';

export type MapRow = Schema<'MapList'>['maps'][number];
export type Refused = Schema<'MapList'>['refused'][number];
export type VersionRow = Schema<'VersionList'>['versions'][number];
export type DriveRow = Schema<'DriveList'>['drives'][number];
export type JobRow = AnswerOf<'/v1/jobs/{job}', 'get'>;

const kStates: Record<MapRow['state'], { tone: Tone; text: string }> = {
  ready: { tone: 'good', text: 'Ready' },
  loading: { tone: 'live', text: 'Loading' },
  opened: { tone: 'live', text: 'Opening' },
  failed: { tone: 'bad', text: 'Failed' },
  empty: { tone: 'plain', text: 'No active version' },
};

export function stateOf(map: Pick<MapRow, 'state'>): { tone: Tone; text: string } {
  return kStates[map.state] ?? { tone: 'plain', text: map.state };
}

/** Default values of build options: these are not shown. */
const kDefaults: Record<string, string> = {
  preset: 'default', odometry: 'default', given_poses: 'refine', movable: 'project', clean: 'free-space', fusion: 'on', fill: 'on', loops: 'on', edits: 'none',
};
/** The options that are shown, in this order. */
const kShown = ['preset', 'detector', 'clean', 'movable', 'odometry', 'given_poses', 'fusion', 'fill', 'loops', 'edits'];

/** The build options that differ from the defaults, as short texts: "detector voxelnext". */
export function changedOptions(options: Record<string, string> | undefined): string[] {
  if (options === undefined) return [];
  return kShown.flatMap((name) => {
    const value = options[name];
    return value === undefined || value === '' || value === kDefaults[name] ? [] : [`${name} ${value}`];
  });
}

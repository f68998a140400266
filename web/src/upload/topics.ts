// Topics of a recording, and which of them a map is made of. The words are those of `maps/drives.md`.

import type { Schema } from '../api/client.js';

/** A topic that can be chosen: of a file here, or of a drive on the server. */
export type Topic = NonNullable<Schema<'DriveInspection'>>['choices'][number];
export type Word = Topic['word'];

/**
 * What is chosen, by word: names of topics (of `cloud` several, parted by commas), `none`, or the frame of the poses.
 * `other` holds words as the server takes them; they count before the others.
 */
export type Selected = Partial<Record<Word | 'pose_frame' | 'other', string>>;

const kOrder = ['cloud', 'poses', 'pose_frame', 'gnss', 'imu'] as const;
/** PoseStamped with fewer poses than one for so many scans holds goals. */
const kMostScansAPose = 40;

/** The words of a choice, as of a folder's `topics.txt`: "cloud=/front&poses=/odom", parted by & or by blanks and lines. */
export function wordsIn(text: string): Map<string, string> {
  return new Map(text.split(/[&\s]+/).filter((part) => part.includes('=')).map((part) => {
    const sign = part.indexOf('=');
    return [part.slice(0, sign), part.slice(sign + 1)];
  }));
}

export function topicsIn(cloud: string | undefined): string[] {
  return (cloud ?? '').split(',').filter((topic) => topic !== '');
}

/** @param topics  those that there are: others are left out, as they are of another file. Undefined leaves all. */
function wordsOf(selected: Selected, topics?: readonly Topic[]): Map<string, string> {
  const words = new Map<string, string>();
  for (const word of kOrder) {
    const isThere = (value: string): boolean => word === 'pose_frame' || value === 'none' || topics === undefined
      || topics.some((topic) => topic.word === word && topic.topic === value);
    const value = (selected[word]?.trim() ?? '').split(',').filter((each) => each !== '' && isThere(each)).join(',');
    if (value !== '') words.set(word, value);
  }
  for (const [word, value] of wordsIn(selected.other ?? '')) words.set(word, value);
  return words;
}

/** As the server takes it: "cloud=/front&poses=/odom"; empty if nothing is chosen. */
export function choiceOf(selected: Selected, topics?: readonly Topic[]): string {
  return [...wordsOf(selected, topics)].map(([word, value]) => `${word}=${value}`).join('&');
}

/**
 * What has to be chosen before the server can read the recording, as far as the topics tell.
 *
 * @param own  the text of the recording's own `topics.txt`.
 */
export function undecided(topics: readonly Topic[], selected: Selected, own = ''): Word[] {
  const words: Word[] = [];
  const chosen = new Map([...wordsIn(own), ...wordsOf(selected, topics)]);
  const clouds = topics.filter(({ word }) => word === 'cloud');
  if (clouds.length > 1 && !chosen.has('cloud')) words.push('cloud');
  const [reference] = topicsIn(chosen.get('cloud'));
  const scans = Math.max(0, ...clouds.filter(({ topic }) => topic === (reference ?? topic)).map(({ messages }) => messages));
  const poses = topics.filter(({ word, type, messages }) => word === 'poses' && messages > 1
    && (type === 'nav_msgs/msg/Odometry' || (type === 'geometry_msgs/msg/PoseStamped' && messages * kMostScansAPose >= scans)));
  if (poses.length > 1 && !chosen.has('poses')) words.push('poses');
  return words;
}

/** What the server says of a choice, with its words as this page takes them: of 'run.mcap?cloud=/front' what is behind the ?. */
export function asOnPage(text: string): string {
  return text.replace(/'[^'?]*\?(\w+=[^']*)'/g, '“$1”');
}

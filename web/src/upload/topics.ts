// Topics of a recording, and which of them a map is made of. The words are those of `maps/drives.md`.

import type { Schema } from '../api/client.js';

/** A topic that can be chosen: of a file here, or of a drive on the server. */
export type Topic = NonNullable<Schema<'DriveInspection'>>['choices'][number];
export type Word = Topic['word'];

/** What is chosen, by word: names of topics, `none`, or the frame of the poses. */
export type Selected = Partial<Record<Word | 'pose_frame', string>>;

const kOrder: readonly (keyof Selected)[] = ['cloud', 'poses', 'pose_frame', 'gnss', 'imu'];
/** PoseStamped with fewer poses than one for so many scans holds goals. */
const kMostScansAPose = 40;

/** As the server takes it: "cloud=/front&poses=/odom"; empty if nothing is chosen. */
export function choiceOf(selected: Selected): string {
  return kOrder.flatMap((word) => {
    const value = selected[word]?.trim() ?? '';
    return value === '' ? [] : [`${word}=${value}`];
  }).join('&');
}

/** What has to be chosen before the server can read the recording, as far as the topics tell. */
export function undecided(topics: readonly Topic[], selected: Selected): Word[] {
  const words: Word[] = [];
  const clouds = topics.filter(({ word }) => word === 'cloud');
  if (clouds.length > 1 && choiceOf({ cloud: selected.cloud ?? '' }) === '') words.push('cloud');
  const scans = Math.max(0, ...clouds.filter(({ topic }) => topic === (selected.cloud ?? topic)).map(({ messages }) => messages));
  const poses = topics.filter(({ word, type, messages }) => word === 'poses' && messages > 1
    && (type === 'nav_msgs/msg/Odometry' || (type === 'geometry_msgs/msg/PoseStamped' && messages * kMostScansAPose >= scans)));
  if (poses.length > 1 && choiceOf({ poses: selected.poses ?? '' }) === '') words.push('poses');
  return words;
}

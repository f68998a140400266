// Reads the index at the end of MCAP files and bags of ROS 1. Loaded when the first of them is chosen.

import { Bag } from '@foxglove/rosbag';
import { McapIndexedReader } from '@mcap/core';
import type { Topic, Word } from './topics.js';

const kWords: Record<string, Word> = {
  'sensor_msgs/msg/PointCloud2': 'cloud',
  'nav_msgs/msg/Odometry': 'poses',
  'geometry_msgs/msg/PoseStamped': 'poses',
  'tf2_msgs/msg/TFMessage': 'poses',
  'sensor_msgs/msg/NavSatFix': 'gnss',
};
/** Larger indexes are of files with millions of chunks; the server reads them. */
const kMostIndexBytes = 64 << 20;

/** The topics of a recording; those of its parts are added up. @throws Error for another kind of file, or one without an index. */
export async function readTopics(files: readonly Blob[]): Promise<Topic[]> {
  const all = new Map<string, Topic>();
  for (const topic of (await Promise.all(files.map(topicsOfFile))).flat()) {
    all.set(topic.choice, { ...topic, messages: topic.messages + (all.get(topic.choice)?.messages ?? 0) });
  }
  return [...all.values()].sort((a, b) => (a.topic < b.topic ? -1 : 1));
}

async function topicsOfFile(file: Blob): Promise<Topic[]> {
  const magic = new TextDecoder('latin1').decode(await file.slice(0, 5).arrayBuffer());
  const topics = magic === '#ROSB' ? await topicsOfRosbag(file) : await topicsOfMcap(file);
  return topics.filter(({ topic, messages, type }) =>
    messages > 0 && !(type === 'tf2_msgs/msg/TFMessage' && topic.endsWith('tf_static')));
}

function topicOf(topic: string, type: string, messages: number): Topic[] {
  const word = kWords[type];
  return word === undefined ? [] : [{ choice: `${word}=${topic}`, word, topic, type, messages, frame_id: '' }];
}

async function topicsOfMcap(file: Blob): Promise<Topic[]> {
  const read = (offset: bigint, size: bigint): Promise<Uint8Array> => bytesOf(file, Number(offset), Number(size));
  const { channelsById, schemasById, statistics } = await McapIndexedReader.Initialize({
    readable: { size: () => Promise.resolve(BigInt(file.size)), read },
  });
  if (statistics === undefined) throw new Error('no statistics');
  return [...channelsById.values()].flatMap(({ id, topic, schemaId }) =>
    topicOf(topic, ros2Type(schemasById.get(schemaId)?.name ?? ''), Number(statistics.channelMessageCounts.get(id) ?? 0n)));
}

async function topicsOfRosbag(file: Blob): Promise<Topic[]> {
  const bag = new Bag({ size: () => file.size, read: (offset, length) => bytesOf(file, offset, length) });
  await bag.open();
  const counts = new Map<number, number>();
  for (const { conn, count } of bag.chunkInfos.flatMap(({ connections }) => connections)) {
    counts.set(conn, (counts.get(conn) ?? 0) + count);
  }
  if (counts.size === 0) throw new Error('no index');
  return [...bag.connections.values()].flatMap(({ conn, topic, type }) => topicOf(topic, ros2Type(type ?? ''), counts.get(conn) ?? 0));
}

async function bytesOf(file: Blob, offset: number, length: number): Promise<Uint8Array> {
  if (length > kMostIndexBytes) throw new Error(`an index of ${length} bytes`);
  return new Uint8Array(await file.slice(offset, offset + length).arrayBuffer());
}

/** ROS 1's "sensor_msgs/PointCloud2" as ROS 2 writes it. */
function ros2Type(type: string): string {
  return type === 'tf/tfMessage' ? 'tf2_msgs/msg/TFMessage' : type.replace(/^([^/]+)\/([^/]+)$/, '$1/msg/$2');
}

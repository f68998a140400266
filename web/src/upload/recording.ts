// Reads the index at the end of MCAP files and bags of ROS 1. Loaded when the first of them is chosen.

import { McapIndexedReader } from '@mcap/core';
import type { Topic, Word } from './topics.js';

const kWords: Record<string, Word> = {
  'sensor_msgs/msg/PointCloud2': 'cloud',
  'livox_interfaces/msg/CustomMsg': 'cloud',
  'livox_ros_driver/msg/CustomMsg': 'cloud',
  'livox_ros_driver2/msg/CustomMsg': 'cloud',
  'velodyne_msgs/msg/VelodyneScan': 'cloud',
  'nav_msgs/msg/Odometry': 'poses',
  'geometry_msgs/msg/PoseStamped': 'poses',
  'tf2_msgs/msg/TFMessage': 'poses',
  'sensor_msgs/msg/NavSatFix': 'gnss',
  'sensor_msgs/msg/Imu': 'imu',
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

/** By wiki.ros.org/Bags/Format/2.0. `@foxglove/rosbag` makes code from texts, which the page's policy refuses. */
async function topicsOfRosbag(file: Blob): Promise<Topic[]> {
  const [head] = recordsOf(await bytesOf(file, kRosbagMagic, 4096));
  const index = Number(viewOf(head?.fields['index_pos']).getBigUint64(0, true));
  if (index === 0) throw new Error('no index');
  const connections = new Map<number, { topic: string; type: string; messages: number }>();
  for (const { fields, data } of recordsOf(await bytesOf(file, index, file.size - index))) {
    const op = viewOf(fields['op']).getUint8(0);
    if (op === kConnection) {
      const conn = viewOf(fields['conn']).getUint32(0, true);
      connections.set(conn, { topic: textOf(fields['topic']), type: textOf(fieldsOf(data)['type']), messages: 0 });
    } else if (op === kChunkInfo) {
      for (let at = 0; at < data.length; at += 8) {
        const found = connections.get(viewOf(data).getUint32(at, true));
        if (found !== undefined) found.messages += viewOf(data).getUint32(at + 4, true);
      }
    }
  }
  return [...connections.values()].flatMap(({ topic, type, messages }) => topicOf(topic, ros2Type(type), messages));
}

const kRosbagMagic = '#ROSBAG V2.0\n'.length;
const kChunkInfo = 6;
const kConnection = 7;

type Fields = Record<string, Uint8Array>;

/** The records that follow each other. @throws RangeError if one is cut off. */
function* recordsOf(bytes: Uint8Array): Generator<{ fields: Fields; data: Uint8Array }> {
  for (let at = 0; at < bytes.length;) {
    const dataAt = at + 4 + viewOf(bytes).getUint32(at, true);
    const end = dataAt + 4 + viewOf(bytes).getUint32(dataAt, true);
    yield { fields: fieldsOf(bytes.subarray(at + 4, dataAt)), data: bytes.subarray(dataAt + 4, end) };
    at = end;
  }
}

/** "name=value", each after its length. */
function fieldsOf(bytes: Uint8Array): Fields {
  const fields: Fields = {};
  for (let at = 0; at < bytes.length;) {
    const end = at + 4 + viewOf(bytes).getUint32(at, true);
    const field = bytes.subarray(at + 4, end);
    const sign = field.indexOf(0x3d);
    fields[textOf(field.subarray(0, sign))] = field.subarray(sign + 1);
    at = end;
  }
  return fields;
}

function viewOf(bytes: Uint8Array = new Uint8Array()): DataView {
  return new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

function textOf(bytes: Uint8Array | undefined): string {
  return new TextDecoder().decode(bytes);
}

async function bytesOf(file: Blob, offset: number, length: number): Promise<Uint8Array> {
  if (length > kMostIndexBytes) throw new Error(`an index of ${length} bytes`);
  return new Uint8Array(await file.slice(offset, offset + length).arrayBuffer());
}

/** ROS 1's "sensor_msgs/PointCloud2" as ROS 2 writes it. */
function ros2Type(type: string): string {
  return type === 'tf/tfMessage' ? 'tf2_msgs/msg/TFMessage' : type.replace(/^([^/]+)\/([^/]+)$/, '$1/msg/$2');
}

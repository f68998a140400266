// Writes a bag with programs that are not ours: @mcap/core, @foxglove/rosmsg2-serialization, and the tools lz4 and zstd.
// usage: node write_bag.mjs SPEC.json OUT.mcap
//        node write_bag.mjs SPEC.json OUT.cdr      the messages one after the other, for a container of another kind:
//                                                  {topic, bytes, log_ns} as a line of JSON, then so many bytes
//
// SPEC: {topics: [{name, type}], messages: [{topic, log_ns, value}],
//        options: {compression: "" | "lz4" | "zstd", chunk_bytes, chunks, index, statistics}}
// `value` is the message as rosmsg2-serialization takes it; bytes are {file, offset, bytes} or {base64}.

import { spawnSync } from 'node:child_process';
import { closeSync, openSync, readFileSync, writeSync } from 'node:fs';
import { parse } from '@foxglove/rosmsg';
import { MessageWriter } from '@foxglove/rosmsg2-serialization';
import { McapWriter } from '@mcap/core';
import { DEFINITIONS } from './message_types.mjs';

const [specFile, outFile] = process.argv.slice(2);
const spec = JSON.parse(readFileSync(specFile, 'utf8'));
const options = { compression: '', chunk_bytes: 1 << 20, chunks: true, index: true, statistics: true, ...spec.options };
const writers = spec.topics.map(({ type }) => new MessageWriter(parse(DEFINITIONS[type], { ros2: true })));

function bytesOf({ file, offset = 0, bytes, base64 }) {
  if (base64 !== undefined) return new Uint8Array(Buffer.from(base64, 'base64'));
  const all = readFileSync(file);
  return new Uint8Array(all.subarray(offset, bytes === undefined ? undefined : offset + bytes));
}

function serialized({ topic, value }) {
  if (value.buf) return writers[topic].writeMessage({ buf: bytesOf(value.buf) });
  const message = value.data && typeof value.data === 'object' ? { ...value, data: bytesOf(value.data) } : { ...value };
  if (message.packets) message.packets = message.packets.map((each) => ({ ...each, data: bytesOf(each.data) }));
  if (message.timebase) message.timebase = BigInt(message.timebase);
  return writers[topic].writeMessage(message);
}

function packed(bytes) {
  const [program, ...words] = options.compression === 'lz4' ? ['lz4', '-c', '-q'] : ['zstd', '-c', '-q'];
  const { status, stdout, error } = spawnSync(program, words, { input: bytes, maxBuffer: 1 << 30 });
  if (status !== 0) throw error ?? new Error(`${program} failed`);
  return { compression: options.compression, compressedData: new Uint8Array(stdout) };
}

async function writeMcap(out) {
  let position = 0n;
  const writer = new McapWriter({
    writable: {
      async write(bytes) {
        position += BigInt(writeSync(out, bytes));
      },
      position: () => position,
    },
    chunkSize: options.chunk_bytes,
    useChunks: options.chunks,
    useChunkIndex: options.index,
    useMessageIndex: options.index,
    useSummaryOffsets: options.index,
    repeatChannels: options.index,
    repeatSchemas: options.index,
    useStatistics: options.statistics,
    compressChunk: options.compression === '' ? undefined : packed,
  });
  await writer.start({ profile: 'ros2', library: 'oracle' });
  const channels = [];
  for (const { name, type } of spec.topics) {
    const data = new TextEncoder().encode(DEFINITIONS[type]);
    const schemaId = await writer.registerSchema({ name: type, encoding: 'ros2msg', data });
    channels.push(
      await writer.registerChannel({ schemaId, topic: name, messageEncoding: 'cdr', metadata: new Map() }),
    );
  }
  let sequence = 0;
  for (const message of spec.messages) {
    const logTime = BigInt(message.log_ns);
    await writer.addMessage({
      channelId: channels[message.topic],
      sequence: sequence++,
      logTime,
      publishTime: logTime,
      data: serialized(message),
    });
  }
  await writer.end();
}

const out = openSync(outFile, 'w');
if (outFile.endsWith('.mcap')) {
  await writeMcap(out);
} else {
  for (const message of spec.messages) {
    const bytes = serialized(message);
    writeSync(out, `${JSON.stringify({ topic: message.topic, bytes: bytes.length, log_ns: message.log_ns })}\n`);
    writeSync(out, bytes);
  }
}
closeSync(out);

import assert from 'node:assert/strict';
import { test } from 'node:test';

const { SseParser } = await import('../../../web/dist/unit/api/sse.js');

const kStream = 'id: 7\nevent: progress\ndata: {"a": 1}\ndata: two\n\n:\n\ndata:bare\r\n\r\nretry: 250\nevent: nothing\n\n';
const kEvents = [
  { id: '7', event: 'progress', data: '{"a": 1}\ntwo' },
  { id: '7', event: 'message', data: 'bare' },
];

test('events come whole, whatever the pieces of the stream', () => {
  for (let size = 1; size <= kStream.length; ++size) {
    const parser = new SseParser();
    const events = [];
    for (let at = 0; at < kStream.length; at += size) events.push(...parser.push(kStream.slice(at, at + size)));
    assert.deepEqual(events, kEvents, `pieces of ${size}`);
  }
});

test('an event that is cut off never comes', () => {
  assert.deepEqual(new SseParser().push('id: 1\ndata: half'), []);
});

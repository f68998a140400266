import assert from 'node:assert/strict';
import { test } from 'node:test';

const { HeightHistogram, heightColour, heightRamp } = await import('../../../web/dist/unit/colour.js');
const { fitView } = await import('../../../web/dist/unit/fit.js');
const { nearestFirst } = await import('../../../web/dist/unit/queue.js');

test('heights beyond the range take the colours of its ends', () => {
  assert.deepEqual(heightColour(-5, 'dark'), heightColour(0, 'dark'));
  assert.deepEqual(heightColour(7, 'light'), heightColour(1, 'light'));
  assert.equal(heightRamp(16, 'dark').length, 64);
});

test('a few stray points do not stretch the range', () => {
  const histogram = new HeightHistogram();
  const heights = [...Array.from({ length: 1000 }, (_, i) => i / 100), 500, -500];
  histogram.add(new Float32Array(heights.flatMap((z) => [0, 0, z])));
  const { low, high } = histogram.range();
  assert.ok(low >= 0 && low < 0.5, `low ${low}`);
  assert.ok(high > 9.5 && high <= 10, `high ${high}`);
  assert.equal(new HeightHistogram().range(), undefined);
});

test('the whole map lies in front of the eye', () => {
  const corners = [[0, 0, 0], [100, 0, 0], [100, 30, 10], [0, 30, 10]];
  const { eye, target } = fitView(corners, Math.PI / 4, 16 / 9, 0.9);
  const forward = target.map((value, axis) => value - eye[axis]);
  for (const corner of corners) {
    const depth = forward.reduce((sum, f, axis) => sum + f * (corner[axis] - eye[axis]), 0);
    assert.ok(depth > 0);
  }
});

test('tiles come from the middle outward', () => {
  const tile = (x) => ({ min: [x, 0, 0], max: [x + 20, 20, 5] });
  assert.deepEqual(nearestFirst([tile(0), tile(20), tile(40)]).map((t) => t.min[0])[0], 20);
});

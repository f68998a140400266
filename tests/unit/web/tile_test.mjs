import assert from 'node:assert/strict';
import { test } from 'node:test';

const { decodeTile } = await import('../../../web/dist/unit/tile.js');

/** One point as the server sends it. */
function point(bytes, index, [x, y, z], kind) {
  const view = new DataView(bytes);
  [x, y, z].forEach((value, axis) => view.setFloat32(20 * index + 4 * axis, value, true));
  view.setUint8(20 * index + 18, kind);
}

test('points go to the layer of their kind, filled ground to the projected', () => {
  const bytes = new ArrayBuffer(80);
  [0, 1, 2, 3].forEach((kind) => point(bytes, kind, [kind, 10 + kind, 20 + kind], kind));
  const tile = decodeTile(bytes, 4);
  assert.deepEqual([...tile.measured], [0, 10, 20]);
  assert.deepEqual([...tile.ground], [1, 11, 21]);
  assert.deepEqual([...tile.projected], [2, 12, 22, 3, 13, 23]);
});

test('a cut-off tile is refused with both sizes', () => {
  assert.throws(() => decodeTile(new ArrayBuffer(39), 2), /39 bytes, expected 40/);
});

test('an unknown kind and a coordinate that is not finite are refused', () => {
  const bytes = new ArrayBuffer(20);
  point(bytes, 0, [0, 0, 0], 4);
  assert.throws(() => decodeTile(bytes, 1), /kind 4/);
  point(bytes, 0, [0, Number.NaN, 0], 0);
  assert.throws(() => decodeTile(bytes, 1), /coordinate y/);
});

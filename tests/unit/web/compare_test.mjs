// What the comparison computes by itself: places of a difference, the address, points of a tile.
import assert from 'node:assert/strict';
import { test } from 'node:test';

const built = (name) => import(`../../../web/dist/unit/compare/${name}.js`);
const { biggestPlaces, sideWords } = await built('difference');
const { kCompareDefaults, readCompareState, writeCompareState } = await built('compare_state');
const { glbPoints } = await built('glb');

const side = (area_m2, x, y) => ({
  points: 10 * area_m2, kinds: { measured: 10 * area_m2 }, area_m2, min: [20 * x, 20 * y, 0], max: [20 * x + 18, 20 * y + 5, 2], url: '',
});
const tile = (x, y, version, other) => ({
  x, y, only_in_version: version === 0 ? null : side(version, x, y), only_in_other: other === 0 ? null : side(other, x, y),
});

test('changes that come near each other make one place, biggest first', () => {
  // What differs lies in the first 18 m of each tile: 2 m from the next one along x.
  const places = biggestPlaces([tile(0, 0, 5, 0), tile(1, 0, 3, 4), tile(9, 9, 1, 1), tile(50, 0, 0, 30)], 10);
  assert.deepEqual(places.map((place) => [place.onlyInVersion_m2, place.onlyInOther_m2]), [[0, 30], [8, 4], [1, 1]]);
  assert.deepEqual([places[1].min, places[1].max], [[0, 0, 0], [38, 5, 2]]);
});

test('changes of neighbouring tiles that lie far from each other are two places', () => {
  assert.equal(biggestPlaces([tile(0, 0, 5, 0), tile(0, 1, 3, 0)], 10).length, 2);
});

test('a street that changed all along gives places of three tiles at most', () => {
  const places = biggestPlaces(Array.from({ length: 30 }, (_, x) => tile(x, 0, 1 + (x % 3), 0)), 5);
  assert.equal(places.length, 5);
  for (const place of places) assert.ok(place.max[0] - place.min[0] <= 60);
});

test('tiles without a changed square are no place', () => {
  assert.deepEqual(biggestPlaces([], 5), []);
  assert.deepEqual(biggestPlaces([tile(0, 0, 0, 0)], 5), []);
});

test('a side is told by points, area and kinds', () => {
  const side = { points: 1234, area_m2: 87.4, kinds: { measured: 1000, ground: 234, filled: 0 }, seen_free: 0 };
  assert.equal(sideWords(side), '1,234 points on 87 m²: 1,000 measured, 234 ground');
  assert.equal(sideWords({ ...side, seen_free: 900 }),
    '1,234 points on 87 m²: 1,000 measured, 234 ground; 900 where the other map saw free space');
  assert.equal(sideWords({ points: 0, area_m2: 0, kinds: {}, seen_free: 0 }), 'nothing');
});

test('what is written into the address is read again; nonsense keeps the defaults', () => {
  const state = { layout: 'side', split: 0.25, above: true, difference: false, tolerance_m: 0.3 };
  const written = writeCompareState(state, new URLSearchParams('view=kept'));
  assert.equal(written.get('view'), 'kept');
  assert.deepEqual(readCompareState(written), state);
  assert.equal(writeCompareState(kCompareDefaults, new URLSearchParams()).toString(), '');
  assert.deepEqual(readCompareState(new URLSearchParams('split=7&layout=up&tolerance_m=-1&above=yes')), kCompareDefaults);
});

/** A GLB of chunks as [kind, bytes]. */
function glbOf(...chunks) {
  const pieces = chunks.flatMap(([kind, bytes]) => {
    const head = Buffer.alloc(8);
    head.writeUInt32LE(bytes.length, 0);
    head.write(kind, 4, 'latin1');
    return [head, bytes];
  });
  const head = Buffer.alloc(12);
  head.write('glTF', 0);
  const whole = Buffer.concat([head, ...pieces]);
  return whole.buffer.slice(whole.byteOffset, whole.byteOffset + whole.length);
}

const kJson = Buffer.from('{"nodes":[{"matrix":[1,0,0,0,0,0,-1,0,0,1,0,0,1000000,5,60,1]}]}');

test('coordinates of a tile are read from its points of 20 bytes, its corner from the matrix of its node', () => {
  const points = Buffer.alloc(40);
  [1, 2, 3].forEach((value, axis) => points.writeFloatLE(value, 20 + 4 * axis));
  const { positions, corner } = glbPoints(glbOf(['JSON', kJson], ['BIN\0', points]));
  assert.deepEqual([...positions], [0, 0, 0, 1, 2, 3]);
  assert.deepEqual(corner, [1_000_000, -60, 5]);
});

test('what is no tile is refused in words', () => {
  assert.throws(() => glbPoints(new ArrayBuffer(3)), /not a GLB file/);
  assert.throws(() => glbPoints(glbOf(['JSON', kJson])), /without points/);
  assert.throws(() => glbPoints(glbOf(['JSON', Buffer.from('{}  ')], ['BIN\0', Buffer.alloc(40)])), /without points/);
  assert.throws(() => glbPoints(glbOf(['JSON', kJson], ['BIN\0', Buffer.alloc(40)]).slice(0, 110)), /without points/);
});

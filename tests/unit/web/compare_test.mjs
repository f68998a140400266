// What the comparison computes by itself: places of a difference, the address, where each side is drawn.
import assert from 'node:assert/strict';
import { test } from 'node:test';

const built = (name) => import(`../../../web/dist/unit/compare/${name}.js`);
const { biggestPlaces, sideWords } = await built('difference');
const { kCompareDefaults, readCompareState, writeCompareState } = await built('compare_state');
const { planPanes } = await built('panes');

const side = (area_m2, x, y) => ({
  points: 10 * area_m2, kinds: { measured: 10 * area_m2 }, area_m2, min: [20 * x, 20 * y, 0], max: [20 * x + 5, 20 * y + 5, 2], url: '',
});
const tile = (x, y, version, other) => ({
  x, y, only_in_version: version === 0 ? null : side(version, x, y), only_in_other: other === 0 ? null : side(other, x, y),
});

test('neighbouring tiles make one place, biggest first', () => {
  const places = biggestPlaces([tile(0, 0, 5, 0), tile(1, 0, 3, 4), tile(9, 9, 1, 1), tile(50, 0, 0, 30)], 10);
  assert.deepEqual(places.map((place) => [place.onlyInVersion_m2, place.onlyInOther_m2]), [[0, 30], [8, 4], [1, 1]]);
  assert.deepEqual([places[1].min, places[1].max], [[0, 0, 0], [25, 5, 2]]);
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
  assert.equal(sideWords({ points: 1234, area_m2: 87.4, kinds: { measured: 1000, ground: 234, filled: 0 } }),
    '1,234 points on 87 m²: 1,000 standing, 234 ground');
  assert.equal(sideWords({ points: 0, area_m2: 0, kinds: {} }), 'nothing');
});

test('what is written into the address is read again; nonsense keeps the defaults', () => {
  const state = { layout: 'side', split: 0.25, above: true, difference: false, tolerance_m: 0.3 };
  const written = writeCompareState(state, new URLSearchParams('view=kept'));
  assert.equal(written.get('view'), 'kept');
  assert.deepEqual(readCompareState(written), state);
  assert.equal(writeCompareState(kCompareDefaults, new URLSearchParams()).toString(), '');
  assert.deepEqual(readCompareState(new URLSearchParams('split=7&layout=up&tolerance_m=-1&above=yes')), kCompareDefaults);
});

test('swiped, both sides fill the picture and meet at the slider; side by side, each has a half', () => {
  const [a, b] = planPanes('swipe', 0.25, 800, 600);
  assert.deepEqual([a.scissor.width, b.scissor.x, b.scissor.width], [200, 200, 600]);
  assert.deepEqual(a.viewport, { x: 0, y: 0, width: 800, height: 600 });
  const [left, right] = planPanes('side', 0.25, 801, 600);
  assert.deepEqual([left.viewport.width + right.viewport.width, right.viewport.x], [801, left.viewport.width]);
  assert.deepEqual(planPanes('swipe', 7, 800, 600)[1].scissor.width, 0);
});

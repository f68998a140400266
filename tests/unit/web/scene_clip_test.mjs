import assert from 'node:assert/strict';
import { test } from 'node:test';

const { contains } = await import('../../../web/dist/unit/scene/clip_box.js');
const { canPull, handlesOf, pulled } = await import('../../../web/dist/unit/scene/clip_handles.js');
const { planesOf } = await import('../../../web/dist/unit/scene/clip_planes.js');
const { areaOf } = await import('../../../web/dist/unit/scene/region.js');
const { Vector3 } = await import('../../../web/node_modules/three/build/three.module.js');

const kBox = { centre: [10, 5, 1], size: [4, 2, 3], yaw: Math.PI / 6 };
const [kCos, kSin] = [Math.cos(kBox.yaw), Math.sin(kBox.yaw)];
const near = (a, b) => a.every((value, i) => Math.abs(value - b[i]) < 1e-9);
/** A ray from straight above through a place. */
const downTo = ([x, y, z]) => ({ origin: [x, y, z + 30], direction: [0, 0, -1] });

test('the planes of a box hold what the box holds', () => {
  const planes = planesOf(kBox);
  let inside = 0;
  for (let i = 0; i < 2000; ++i) {
    // A lattice that is not in step with the box.
    const place = [7 + 0.611 * (i % 10), 2 + 0.617 * (Math.floor(i / 10) % 10), -1.3 + 0.241 * Math.floor(i / 100)];
    const held = planes.every((plane) => plane.distanceToPoint(new Vector3(...place)) >= 0);
    assert.equal(held, contains(kBox, ...place), String(place));
    inside += held ? 1 : 0;
  }
  assert.ok(inside > 20 && inside < 1900, `${inside}`);
});

test('the area of a box holds its corners and touches them', () => {
  const { min, max } = areaOf(kBox);
  const reach = [2 * kCos + 1 * kSin, 2 * kSin + 1 * kCos];
  assert.ok(near(min, [10 - reach[0], 5 - reach[1]]) && near(max, [10 + reach[0], 5 + reach[1]]), `${min} ${max}`);
});

test('the handles of a box are the middles of its faces and its own', () => {
  const handles = handlesOf(kBox);
  assert.equal(handles.length, 7);
  assert.ok(near(handles[0].place, [10 + 2 * kCos, 5 + 2 * kSin, 1]));
  assert.ok(near(handles[3].place, [10 + kSin, 5 - kCos, 1]));
  assert.ok(near(handles[5].place, [10, 5, -0.5]));
  assert.deepEqual([handles[6].place, handles[6].normal], [kBox.centre, undefined]);
});

test('a pulled face goes along its normal, and the opposite one stays', () => {
  const [front, back] = handlesOf(kBox);
  // 1.5 m outwards, and 7 m aside, which counts for nothing.
  const at = [front.place[0] + 1.5 * kCos - 7 * kSin, front.place[1] + 1.5 * kSin + 7 * kCos, 1];
  const longer = pulled(kBox, front, downTo(at));
  assert.ok(Math.abs(longer.size[0] - 5.5) < 1e-9 && near(longer.size.slice(1), [2, 3]));
  assert.ok(near(handlesOf(longer)[1].place, back.place));
  const other = pulled(kBox, back, downTo([back.place[0] - kCos, back.place[1] - kSin, 1]));
  assert.ok(Math.abs(other.size[0] - 5) < 1e-9 && near(handlesOf(other)[0].place, front.place));
});

test('a face stops short of the opposite one', () => {
  const [front, back] = handlesOf(kBox);
  const thin = pulled(kBox, front, downTo([front.place[0] - 50 * kCos, front.place[1] - 50 * kSin, 1]));
  assert.ok(Math.abs(thin.size[0] - 0.1) < 1e-9 && near(handlesOf(thin)[1].place, back.place));
});

test('what is looked at along its normal is not pulled; the lid is from aside', () => {
  const lid = handlesOf(kBox)[4];
  assert.ok(!canPull(lid, [0, 0, -1]));
  assert.equal(pulled(kBox, lid, downTo([0, 0, 0])), kBox);
  const higher = pulled(kBox, lid, { origin: [10, -20, 4.5], direction: [0, 1, 0] });
  assert.ok(Math.abs(higher.size[2] - 5) < 1e-9 && Math.abs(higher.centre[2] - 2) < 1e-9);
});

test('the middle takes the box over the ground, at its height', () => {
  const [middle] = handlesOf(kBox).slice(-1);
  const moved = pulled(kBox, middle, { origin: [0, 0, 11], direction: [0.6, 0, -0.8] });
  assert.ok(near(moved.centre, [7.5, 0, 1]) && moved.size === kBox.size);
  assert.equal(pulled(kBox, middle, { origin: [0, 0, 11], direction: [0.6, 0, 0.8] }), kBox, 'above the horizon');
});

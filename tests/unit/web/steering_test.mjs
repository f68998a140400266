import assert from 'node:assert/strict';
import { test } from 'node:test';

const { Steering } = await import('../../../web/dist/unit/scene/steering.js');
const { OrthographicCamera, PerspectiveCamera } = await import('../../../web/node_modules/three/build/three.module.js');

/** What the controls want of a canvas. */
const kCanvas = (() => {
  const target = { addEventListener: () => undefined, removeEventListener: () => undefined };
  return { ...target, style: {}, clientWidth: 800, clientHeight: 600, getRootNode: () => target, ownerDocument: target };
})();
const kShape = [0, 120].flatMap((x) => [0, 60].flatMap((y) => [0, 25].map((z) => [1000 + x, 2000 + y, z])));

function steering() {
  const made = new Steering(kCanvas, [1000, 2000, 0], () => kShape, () => undefined);
  made.aspect = 4 / 3;
  return made;
}
const drawn = (made) => {
  made.prepare(0, [{ min: [1000, 2000, 0], max: [1120, 2060, 25] }]);
  return made.lens;
};
const seenAt = (made, place) => made.toLocal(place).project(made.lens);
const press = (made, key) => made.onKey({ key, preventDefault: () => undefined });

test('straight down the picture is a plan: a tower stands on its own foot', () => {
  const made = steering();
  made.showAll('above');
  assert.ok(drawn(made) instanceof OrthographicCamera);
  for (const [x, y] of [[1000, 2000], [1120, 2060], [1017, 2055]]) {
    const [foot, top] = [seenAt(made, [x, y, 0]), seenAt(made, [x, y, 25])];
    assert.ok(Math.hypot(foot.x - top.x, foot.y - top.y) < 0.01, `${x} ${y}`);
    assert.ok(top.z < foot.z, 'and the top is nearer');
    assert.ok(Math.abs(foot.x) <= 1 && Math.abs(foot.y) <= 1, 'all of it is in the picture');
  }
  const corner = seenAt(made, [1120, 2060, 0]);
  assert.ok(Math.max(Math.abs(corner.x), Math.abs(corner.y)) > 0.9, 'and fills it');
  made.dispose();
});

test('tilted it has perspective, and shows the same at the height of the target', () => {
  const made = steering();
  made.showAll('above');
  drawn(made);
  const { target } = made.view;
  const places = [[1010, 2010, target[2]], [1100, 2050, target[2]]];
  const before = places.map((place) => seenAt(made, place));
  // Just beyond what counts as straight down.
  const { eye } = made.view;
  const reach = Math.hypot(...eye.map((value, i) => value - target[i]));
  made.setView({ target, eye: [target[0], target[1] - reach * Math.sin(0.011), target[2] + reach * Math.cos(0.011)] });
  assert.ok(drawn(made) instanceof PerspectiveCamera);
  places.map((place) => seenAt(made, place)).forEach((seen, i) =>
    assert.ok(Math.hypot(seen.x - before[i].x, seen.y - before[i].y) < 0.02, `${seen.x} ${seen.y}`));
  const [foot, top] = [seenAt(made, [1120, 2060, 0]), seenAt(made, [1120, 2060, 25])];
  assert.ok(Math.hypot(foot.x - top.x, foot.y - top.y) > 0.1);
  made.dispose();
});

test('zoom by key is that of the plan too, and a turn by key leaves it', () => {
  const made = steering();
  made.showAll('above');
  const wide = drawn(made).right;
  press(made, '+');
  assert.ok(Math.abs(drawn(made).right - wide / 1.15) < 1e-6 * wide);
  press(made, 'ArrowDown');
  assert.ok(drawn(made) instanceof PerspectiveCamera);
  press(made, 't');
  assert.ok(drawn(made) instanceof OrthographicCamera);
  made.dispose();
});

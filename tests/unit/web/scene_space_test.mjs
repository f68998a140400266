import assert from 'node:assert/strict';
import { test } from 'node:test';

const { boxOverDiagonal, contains, corners, mayTouch, metBy, toUnitCube } = await import('../../../web/dist/unit/scene/clip_box.js');
const { boxOf, lengthOf, profileOf } = await import('../../../web/dist/unit/scene/section.js');
const { between, metres, total } = await import('../../../web/dist/unit/scene/measure.js');
const { PickPoints } = await import('../../../web/dist/unit/scene/pick.js');
const { fitView } = await import('../../../web/dist/unit/scene/fit.js');
const { cellsOf } = await import('../../../web/dist/unit/scene/grid_map.js');
const { gather, wayOf } = await import('../../../web/dist/unit/scene/seen_objects.js');
const { readPoints } = await import('../../../web/dist/unit/scene/point_layout.js');

const kTurned = { centre: [10, 5, 1], size: [4, 2, 2], yaw: Math.PI / 4 };
/** Fixed random numbers in [0, 1). */
function randoms(seed) {
  let state = seed;
  return () => (state = (state * 1664525 + 1013904223) % 2 ** 32) / 2 ** 32;
}

test('a turned box holds what lies along its length, not what its bounds hold', () => {
  const along = (metres) => [10 + metres * Math.SQRT1_2, 5 + metres * Math.SQRT1_2, 1];
  assert.ok(contains(kTurned, ...along(1.99)));
  assert.ok(!contains(kTurned, ...along(2.01)));
  assert.ok(!contains(kTurned, 11.3, 3.7, 1));
  assert.ok(!contains(kTurned, 10, 5, 2.1));
});

test('the matrix of a box says the same as its test, for any point', () => {
  const m = toUnitCube(kTurned);
  const random = randoms(7);
  for (let i = 0; i < 1000; ++i) {
    const p = [10 + 6 * random() - 3, 5 + 6 * random() - 3, 1 + 4 * random() - 2];
    const row = (r) => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r];
    assert.equal([0, 1, 2].every((r) => Math.abs(row(r)) <= 0.5), contains(kTurned, ...p), String(p));
  }
});

test('a box touches the tiles that hold any of its points', () => {
  const random = randoms(3);
  for (let i = 0; i < 300; ++i) {
    const min = [20 * random(), 10 * random(), 0];
    const max = [min[0] + 3 * random(), min[1] + 3 * random(), 2];
    let holds = false;
    for (let j = 0; j < 200 && !holds; ++j) {
      holds = contains(kTurned, ...[0, 1, 2].map((axis) => min[axis] + random() * (max[axis] - min[axis])));
    }
    if (holds) assert.ok(mayTouch(kTurned, min, max), `${min} ${max}`);
  }
  assert.ok(!mayTouch(kTurned, [11.6, 3, 0], [12, 3.4, 2]), 'beside a turned box, within its bounds');
  assert.ok(!mayTouch(kTurned, [0, 0, 5], [20, 20, 6]));
});

test('the corners of a box lie on it', () => {
  for (const [x, y, z] of corners(kTurned)) {
    assert.ok(contains({ ...kTurned, size: kTurned.size.map((s) => s + 1e-9) }, x, y, z));
    assert.ok(!contains({ ...kTurned, size: kTurned.size.map((s) => s - 1e-9) }, x, y, z));
  }
});

test('a ray meets a box where it enters, and misses it beside', () => {
  assert.ok(Math.abs(metBy({ centre: [10, 0, 0], size: [2, 2, 2], yaw: 0 }, [0, 0, 0], [1, 0, 0]) - 9) < 1e-12);
  assert.equal(metBy({ centre: [10, 0, 0], size: [2, 2, 2], yaw: 0 }, [10, 0, 0], [1, 0, 0]), 0);
  assert.equal(metBy({ centre: [10, 0, 0], size: [2, 2, 2], yaw: 0 }, [0, 1.5, 0], [1, 0, 0]), undefined);
  assert.equal(metBy({ centre: [-10, 0, 0], size: [2, 2, 2], yaw: 0 }, [0, 0, 0], [1, 0, 0]), undefined);
  assert.ok(Math.abs(metBy(kTurned, [10, 5, 20], [0, 0, -1]) - 18) < 1e-9);
});

test('a box over two places holds both, with room above and below', () => {
  const box = boxOverDiagonal([0, 0, 1], [4, -6, 2], 1, 8);
  assert.deepEqual([box.centre, box.size], [[2, -3, 5], [4, 6, 10]]);
});

function points(places) {
  const view = new DataView(new ArrayBuffer(20 * places.length));
  places.forEach(([x, y, z, kind = 0], i) => {
    [x, y, z].forEach((value, axis) => view.setFloat32(20 * i + 4 * axis, value, true));
    view.setUint8(20 * i + 18, kind);
  });
  return readPoints(view.buffer, [0, 0, 0]);
}

test('a profile has the points of the cut, by metres along it and height', () => {
  const section = { from: [0, 0, 0], to: [6, 8, 0], width: 2, low: -1, high: 5 };
  assert.equal(lengthOf(section), 10);
  const tiles = [points([[3, 4, 2], [3 - 0.7, 4 + 0.5, 1], [3 - 0.9, 4 + 0.7, 1], [-0.6, -0.8, 0]]), points([[6, 8, 4.5, 2], [3, 4, 6]])];
  const profile = profileOf(section, tiles, () => true);
  assert.deepEqual([...profile.along].map((a) => Math.round(10 * a)), [50, 50, 100]);
  assert.deepEqual([...profile.heights], [2, 1, 4.5]);
  assert.deepEqual([...profile.kinds], [0, 0, 2]);
  assert.deepEqual([...profileOf(section, tiles, (kind) => kind === 2).heights], [4.5]);
  assert.throws(() => profileOf({ ...section, to: [0, 0, 3] }, tiles, () => true), /same place/);
});

test('the box of a section holds exactly the points of its profile', () => {
  const section = { from: [1, 2, 0], to: [9, -3, 0], width: 1.5, low: 0, high: 4 };
  const random = randoms(11);
  const cloud = points(Array.from({ length: 2000 }, () => [12 * random() - 1, 10 * random() - 5, 6 * random() - 1]));
  const box = boxOf(section);
  let inside = 0;
  for (let i = 0; i < cloud.count; ++i) inside += contains(box, ...cloud.positions.subarray(3 * i, 3 * i + 3)) ? 1 : 0;
  assert.equal(profileOf(section, [cloud], () => true).heights.length, inside);
  assert.ok(inside > 50);
});

test('lengths are told apart by straight, level and rise', () => {
  assert.deepEqual(between([0, 0, 0], [3, 4, -12]), { straight: 13, horizontal: 5, rise: -12 });
  assert.deepEqual(total([[0, 0, 0], [3, 4, 0], [3, 4, 2]]), { straight: 7, horizontal: 5, rise: 2 });
  assert.deepEqual(total([[1, 1, 1]]), { straight: 0, horizontal: 0, rise: 0 });
  assert.deepEqual([metres(1.234), metres(1234.5678)], ['1.23 m', '1.235 km']);
});

test('the point in front is picked, and among those of one surface the one nearest to the ray', () => {
  const values = new Float32Array([10, 0.05, 0, 10.2, 0.01, 0, 20, 0, 0, 5, 3, 0]);
  const cloud = new PickPoints(values, 3, 4);
  const ray = { origin: [0, 0, 0], direction: [1, 0, 0] };
  assert.equal(cloud.nearest(ray, 0.01, () => true, 1e6).hit.index, 1);
  assert.equal(cloud.nearest(ray, 0.01, (i) => i === 2, 1e6).hit.index, 2);
  assert.equal(cloud.nearest({ origin: [0, 0, 0], direction: [-1, 0, 0] }, 0.01, () => true, 1e6).hit, undefined);
  assert.equal(new PickPoints(new Float32Array(0), 3, 0).nearest(ray, 0.01, () => true, 1e6).hit, undefined);
});

test('picking agrees with looking at every point, and looks at few of them', () => {
  const random = randoms(5);
  const count = 50_000;
  const values = new Float32Array(5 * count);
  // In rows, as tiles are.
  for (let i = 0; i < count; ++i) values.set([(i % 250) * 0.1, Math.floor(i / 250) * 0.1, random()], 5 * i);
  const cloud = new PickPoints(values, 5, count);
  let looked = 0;
  for (let i = 0; i < 50; ++i) {
    const to = [25 * random(), 20 * random(), 0.5];
    const away = [to[0] - 12, to[1] - 10, to[2] - 30];
    const length = Math.hypot(...away);
    const ray = { origin: [12, 10, 30], direction: away.map((v) => v / length) };
    const found = cloud.nearest(ray, 0.003, () => true, 1e6);
    looked += found.looked;
    const near = [];
    for (let j = 0; j < count; ++j) {
      const d = [0, 1, 2].map((axis) => values[5 * j + axis] - ray.origin[axis]);
      const depth = d.reduce((sum, v, axis) => sum + v * ray.direction[axis], 0);
      const beside = Math.sqrt(Math.max(d.reduce((sum, v) => sum + v * v, 0) - depth * depth, 0));
      if (depth > 0 && beside <= 0.003 * depth) near.push({ j, depth, beside: beside / depth });
    }
    const first = Math.min(...near.map(({ depth }) => depth));
    const best = near.filter(({ depth }) => depth <= first + 0.5).reduce((a, b) => (b.beside < a.beside ? b : a), { beside: Infinity });
    assert.equal(found.hit?.index, best.j);
  }
  assert.ok(looked / 50 < 0.2 * count, `${looked / 50} of ${count}`);
});

test('a pick ends at its limit', () => {
  const values = new Float32Array(3 * 10_000).fill(1);
  const found = new PickPoints(values, 3, 10_000).nearest({ origin: [0, 1, 1], direction: [1, 0, 0] }, 0.1, () => true, 1000);
  assert.ok(found.looked <= 1024 && found.hit !== undefined);
});

test('the whole map lies in front of the eye', () => {
  const boxCorners = [[0, 0, 0], [100, 0, 0], [100, 30, 10], [0, 30, 10]];
  const { eye, target } = fitView(boxCorners, Math.PI / 4, 16 / 9, 0.9);
  const forward = target.map((value, axis) => value - eye[axis]);
  for (const corner of boxCorners) {
    assert.ok(forward.reduce((sum, f, axis) => sum + f * (corner[axis] - eye[axis]), 0) > 0);
  }
});

test('cells of a grid layer lie where its tiles say, rows from south to north', () => {
  const grid = { tile_size_m: 20, cell_m: 10, cells_per_side: 2, origin: [0, 0, 0], tiles: [[0, 0], [-1, 2]], bands: [] };
  const heights = Float32Array.of(1, NaN, 3, 4, 5, 6, 7, 8);
  const cells = cellsOf(grid, heights, Float32Array.of(9, 9, 0, 9, 1, 2, NaN, 4), (value) => value > 0);
  assert.deepEqual([...cells.x], [0, 10, -20, -10, -10]);
  assert.deepEqual([...cells.y], [0, 10, 40, 40, 50]);
  assert.deepEqual([...cells.height], [1, 4, 5, 6, 8]);
  assert.throws(() => cellsOf(grid, heights, Float32Array.of(1), () => true), /has 1 values, and 8 are expected/);
});

test('entries of one object become one object with its places in the order of the scans', () => {
  const entry = { centre: [0, 0, 0], size: [4, 2, 1.5], yaw: 0, class: 'car', motion: 'moving', score: 1, first_scan: 0, last_scan: 2, points_removed: 5 };
  const objects = gather([
    { ...entry, object: 4, scan: 2, centre: [6, 8, 0] }, { ...entry, object: 1, scan: 0 }, { ...entry, object: 4, scan: 1, centre: [3, 4, 0] },
    { ...entry, object: 4, scan: 0 },
  ]);
  assert.deepEqual(objects.map(({ number, places }) => [number, places.length]), [[4, 3], [1, 1]]);
  assert.deepEqual(objects[0].places.map(({ centre }) => centre[0]), [0, 3, 6]);
  assert.equal(wayOf(objects[0]), 10);
});

import assert from 'node:assert/strict';
import { test } from 'node:test';

const { cornerOf, coordinateOf, readPoints, select } = await import('../../../web/dist/unit/scene/point_layout.js');
const { exportPoints } = await import('../../../web/dist/unit/scene/export_points.js');
const { Histogram } = await import('../../../web/dist/unit/scene/statistics.js');
const { fetchRegion, kRegionLimit, tilesOf } = await import('../../../web/dist/unit/scene/region.js');

const kZero = [0, 0, 0];

/** Points as the server sends them. */
function tile(points) {
  const view = new DataView(new ArrayBuffer(20 * points.length));
  points.forEach(({ at, intensity = 0.5, observations = 1, kind = 0, object = 0 }, i) => {
    at.forEach((value, axis) => view.setFloat32(20 * i + 4 * axis, value, true));
    view.setFloat32(20 * i + 12, intensity, true);
    view.setUint16(20 * i + 16, observations, true);
    view.setUint8(20 * i + 18, kind);
    view.setUint8(20 * i + 19, object);
  });
  return view.buffer;
}

test('a tile is read field by field', () => {
  const points = readPoints(tile([{ at: [1, -2, 3.5], intensity: 0.25, observations: 513, kind: 2 }, { at: [0, 0, 0], kind: 3 }]), kZero, 2);
  assert.deepEqual([...points.positions], [1, -2, 3.5, 0, 0, 0]);
  assert.deepEqual([points.intensities[0], points.observations[0], points.kinds[0], points.kinds[1]], [0.25, 513, 2, 3]);
});

test('a cut-off tile is refused with both sizes, whether or not its number of points is known', () => {
  assert.throws(() => readPoints(new ArrayBuffer(39), kZero, 2), /39 bytes, expected 40/);
  assert.throws(() => readPoints(new ArrayBuffer(39), kZero), /39 bytes, expected 20/);
});

test('an unknown kind and a coordinate that is not finite are refused by name', () => {
  assert.throws(() => readPoints(tile([{ at: [0, 0, 0], kind: 4 }]), kZero, 1), /point 0: kind 4/);
  assert.throws(() => readPoints(tile([{ at: [0, 0, 0] }, { at: [0, NaN, 0] }]), kZero, 2), /point 1: coordinate y/);
});

test('chosen points keep their order and the corner of their tile', () => {
  const points = readPoints(tile([{ at: [1, 0, 0] }, { at: [2, 0, 0], kind: 1 }, { at: [3, 0, 0], observations: 7 }]), [20, 0, 0]);
  const chosen = select(points, (i) => points.kinds[i] === 0);
  assert.deepEqual([...chosen.positions], [1, 0, 0, 3, 0, 0]);
  assert.deepEqual([...chosen.observations], [1, 7]);
  assert.deepEqual(chosen.corner, [20, 0, 0]);
});

test('a point far from the origin is exact: its tile is placed in doubles', () => {
  assert.deepEqual(cornerOf({ level: 0, x: 50_000, y: -3 }), [1_000_000, -60, 0]);
  assert.deepEqual(cornerOf({ level: 3, x: -1, y: 2 }), [-160, 320, 0]);
  const points = readPoints(tile([{ at: [0.000244140625, 2, 3] }]), [1_000_000, -60, 0]);
  assert.deepEqual([0, 1, 2].map((axis) => coordinateOf(points, 0, axis)), [1_000_000.000244140625, -58, 3]);
});

/** The text of a file up to the end of its header, and the bytes behind it. */
async function fileOf(blob, end) {
  const bytes = await blob.arrayBuffer();
  const text = new TextDecoder().decode(bytes);
  const body = text.indexOf(end) + end.length;
  return { header: text.slice(0, body), body: bytes.slice(body) };
}

test('an exported PLY has map coordinates as doubles, exact far from the origin', async () => {
  const points = readPoints(tile([{ at: [0.125, 2, 3], intensity: 0.5, observations: 9, kind: 1 }]), [20, 0, 0]);
  const { header, body } = await fileOf(exportPoints([points], [4_000_000.5, -7, 100], 'ply'), 'end_header\n');
  assert.match(header, /element vertex 1\nproperty double x\n/);
  const view = new DataView(body);
  assert.equal(view.byteLength, 31);
  assert.deepEqual([0, 8, 16].map((at) => view.getFloat64(at, true)), [4_000_020.625, -5, 103]);
  assert.deepEqual([view.getFloat32(24, true), view.getUint16(28, true), view.getUint8(30)], [0.5, 9, 1]);
});

test('an exported PCD has the header and the size that readers expect', async () => {
  const tiles = [[[1, 2, 3]], [[4, 5, 6]]].map((places) => readPoints(tile(places.map((at) => ({ at }))), kZero));
  const { header, body } = await fileOf(exportPoints(tiles, [10, 20, 30], 'pcd'), 'DATA binary\n');
  assert.match(header, /format\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\n/);
  assert.deepEqual([...new Float32Array(body)], [11, 22, 33, 0.5, 14, 25, 36, 0.5]);
});

test('a PCD whose floats would be coarse is refused, and PLY named instead', () => {
  const points = readPoints(tile([{ at: [1, 2, 3] }]), [1_000_000, -60, 0]);
  assert.throws(() => exportPoints([points], [10, 20, 30], 'pcd'), /1000 km .* Choose PLY or CSV/);
  assert.ok(exportPoints([points], [10, 20, 30], 'ply').size > 0);
});

test('an exported CSV has a line for each point', async () => {
  const points = readPoints(tile([{ at: [1, 2, 3], kind: 3 }]), [20, 0, 0]);
  assert.equal(await exportPoints([points], [0, 0, 0.5], 'csv').text(),
    'x_m,y_m,z_m,intensity,observations,kind\n21.0000,2.0000,3.5000,0.5,1,filled\n');
});

test('a few stray values do not stretch the range', () => {
  const histogram = new Histogram(0.1);
  for (let i = 0; i < 1000; ++i) histogram.add(i / 100);
  histogram.add(500);
  histogram.add(-500);
  const { low, high } = histogram.range(0.02, 1);
  assert.ok(low >= 0 && low < 0.5, `low ${low}`);
  assert.ok(high > 9.5 && high <= 10, `high ${high}`);
  assert.equal(new Histogram(0.1).range(0.02, 1), undefined);
  const flat = new Histogram(1);
  flat.add(3);
  assert.deepEqual(flat.range(0.02, 5), { low: 3, high: 8 });
});

const kTiles = [
  { level: 0, x: 0, y: 0, points: 1, min: [0, 0, 0], max: [20, 20, 5] },
  { level: 0, x: 1, y: 0, points: 1, min: [20, 0, 0], max: [40, 20, 5] },
  { level: 1, x: 0, y: 0, points: 1, min: [0, 0, 0], max: [40, 20, 5] },
];

test('a region asks for the tiles of full resolution that it may touch', () => {
  const box = { centre: [30, 10, 0], size: [4, 4, 4], yaw: 0.3 };
  assert.deepEqual(tilesOf(kTiles, box).map(({ x }) => x), [1]);
  assert.equal(tilesOf(kTiles, undefined).length, 2);
});

test('a region is fetched whole, told tile by tile, and a damaged tile is named', async () => {
  const told = [];
  const points = await fetchRegion(kTiles.slice(0, 2), async ({ x }) => tile([{ at: [x, 0, 0] }]), (done, of) => told.push([done, of]));
  assert.deepEqual(points.map(({ positions, corner }) => [positions[0], corner[0]]), [[0, 0], [1, 20]]);
  assert.deepEqual(told, [[1, 2], [2, 2]]);
  await assert.rejects(fetchRegion(kTiles.slice(0, 1), async () => new ArrayBuffer(3), () => {}), /Tile 0\/0\/0 is damaged: has 3 bytes.* Try again/);
});

test('a region too large for a browser is refused before anything is fetched', async () => {
  const large = [{ ...kTiles[0], points: kRegionLimit + 1 }];
  await assert.rejects(fetchRegion(large, () => assert.fail('fetched'), () => {}), /20,000,001 points, more than the 20,000,000 points .* smaller/);
});

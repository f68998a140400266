// What the localization view computes by itself: priors, ellipses, requests, stamps, residuals.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';

const built = (name) => import(`../../../web/dist/unit/localize/${name}.js`);
const { between, headingOf, poseWithHeading } = await built('pose');
const { freeDirection, uncertaintyOf } = await built('uncertainty');
const { curlLine, poseQuery, queryText } = await built('request');
const { byName, stampsOf } = await built('stamps');
const { kMaxResidual_m, MapPoints, tilePositions, tilesAround } = await built('residual');
const { angleWords, lengthWords, reasonWords } = await built('words');

const near = (found, expected, tolerance = 1e-9) =>
  assert.ok(Math.abs(found - expected) <= tolerance, `found ${found}, expected ${expected} within ${tolerance}`);

test('a prior looks where it was dragged to, on level ground and on a slope', () => {
  for (const up of [[0, 0, 1], [0.1, -0.2, 0.97]]) {
    for (const heading of [0, 1, -2.5, Math.PI / 2]) near(headingOf(poseWithHeading([1, 2, 3], heading, up)), heading);
  }
  const level = poseWithHeading([1, 2, 3], Math.PI / 2);
  [0, 0, Math.SQRT1_2, Math.SQRT1_2].forEach((value, i) => near(level.quaternion[i], value));
});

test('a prior on a slope stands on it', () => {
  // A road that climbs by 10 degrees towards +x: looking up the road the nose is up, looking down it is down.
  const up = [-Math.sin(Math.PI / 18), 0, Math.cos(Math.PI / 18)];
  const forwardZ = ({ quaternion: [x, y, z, w] }) => 2 * (x * z - w * y);
  near(forwardZ(poseWithHeading([0, 0, 0], 0, up)), Math.sin(Math.PI / 18));
  near(forwardZ(poseWithHeading([0, 0, 0], Math.PI, up)), -Math.sin(Math.PI / 18));
});

test('between two poses the way is straight, and its ends are the poses', () => {
  const from = poseWithHeading([0, 0, 0], 0);
  const to = poseWithHeading([4, 2, 0], Math.PI / 2);
  assert.deepEqual(between(from, to, 0).position, [0, 0, 0]);
  assert.deepEqual(between(from, to, 1).position, [4, 2, 0]);
  near(headingOf(between(from, to, 0.5)), Math.PI / 4);
});

/** 6 x 6 with these variances on its diagonal. */
const diagonal = (...variances) => Array.from({ length: 36 }, (_, i) => (i % 7 === 0 ? variances[i / 7] : 0));

test('an ellipse is long where the lidar, turned into the map, is unsure', () => {
  const covariance = diagonal(0.04, 0.0001, 0.0009, 0, 0, 0.0004);
  const found = uncertaintyOf(poseWithHeading([5, 5, 0], 0.7), covariance);
  near(found.major_m, 0.2);
  near(found.minor_m, 0.01);
  near(found.angle_rad, 0.7);
  near(found.vertical_m, 0.03);
  near(found.yaw_rad, 0.02);
});

test('of a lidar that lies on its side the height is told by what was sideways', () => {
  const rolled = { position: [0, 0, 0], quaternion: [Math.SQRT1_2, 0, 0, Math.SQRT1_2] };
  const found = uncertaintyOf(rolled, diagonal(1, 4, 9, 0, 0, 0));
  near(found.vertical_m, 2);
  near(found.major_m, 3);
  near(found.minor_m, 1);
});

test('an even covariance has an even ellipse', () => {
  const found = uncertaintyOf(poseWithHeading([0, 0, 0], 1), diagonal(1, 1, 1, 0, 0, 0));
  near(found.major_m, 1);
  near(found.minor_m, 1);
});

test('free directions are told in words and turned into the map', () => {
  const pose = poseWithHeading([0, 0, 0], Math.PI / 2);
  const along = freeDirection(pose, [0.99, 0.1, 0, 0, 0, 0]);
  near(along.slide.y, 0.99);
  assert.equal(along.words, 'can slide forward or back');
  assert.equal(freeDirection(pose, [0, 0, 0, 0, 0, 1]).words, 'can turn to the left or right (yaw)');
});

test('every reason that the localizer gives is put into words', () => {
  const table = readFileSync(new URL('../../../localization/src/reason.cpp', import.meta.url), 'utf8');
  const given = new Set([...table.matchAll(/Reason::k\w+, "([a-z_]+)"/g)].map((row) => row[1]));
  assert.equal(given.size, 19);
  assert.deepEqual([...given].filter((reason) => reasonWords(reason) === reason.replaceAll('_', ' ')), []);
});

test('requests hold what the person chose and nothing else', () => {
  assert.equal(queryText(poseQuery({ kind: 'everywhere' }, 'xyzi')), '');
  const pose = { position: [1.23456, -2, 0], quaternion: [0, 0, 0.5, 0.8660254] };
  assert.equal(queryText(poseQuery({ kind: 'prior', pose }, null)), 'prior_t=1.235,-2,0&prior_q=0,0,0.5,0.866025');
  const gnss = { kind: 'gnss', latitude_deg: 48.5, longitude_deg: 9, altitude_m: null, sigma_m: 3 };
  assert.equal(queryText(poseQuery(gnss, 'xyz')), 'gnss=48.5,9,,3&layout=xyz');
});

test('the curl line quotes names, and never holds a key', () => {
  const scan = { name: "it's.pcd", contentType: 'application/vnd.pcd' };
  const line = curlLine('https://maps.example', '/v1/maps/town/localize?prior_t=0,0,0', scan, true, false);
  assert.equal(line, String.raw`curl -sS -H "Authorization: Bearer $STILLMAP_KEY" -H 'Content-Type: application/vnd.pcd' ` +
    String.raw`--data-binary '@it'\''s.pcd' 'https://maps.example/v1/maps/town/localize?prior_t=0,0,0'`);
});

test('stamps come from times.txt to the nanosecond, else ten a second', () => {
  assert.deepEqual(stampsOf(2, '1511111111.123456789\n1511111111.223456789\n').stamps_ns,
    ['1511111111123456789', '1511111111223456789']);
  assert.deepEqual(stampsOf(2, '0.000000e+00\n1.037303e-01\n').stamps_ns, ['0', '103730000']);
  assert.deepEqual(stampsOf(2, null).stamps_ns, ['100000000', '200000000']);
  assert.match(stampsOf(3, '1\n2\n').source, /2 lines for 3 scans/);
  assert.match(stampsOf(2, '2\n1\n').source, /increasing/);
});

test('scans of a folder come in the order of their numbers', () => {
  const names = ['10.bin', '9.bin', '000011.bin'].map((name) => ({ name })).sort(byName).map((file) => file.name);
  assert.deepEqual(names, ['9.bin', '10.bin', '000011.bin']);
});

test('residuals are distances to the nearest point, across cells and below zero too', () => {
  const map = new MapPoints();
  map.add([0.49, -40, 0, -0.01, -43, 2], [0, 40, 0]);
  near(map.residual(0.51, 0, 0), 0.02);
  near(map.residual(0.01, -3, 2), 0.02);
  assert.equal(map.residual(5, 5, 5), kMaxResidual_m);
});

test('residuals agree with looking at every point', () => {
  let seed = 7;
  const random = () => ((seed = (seed * 48271) % 2147483647) / 2147483647) * 3 - 1.5;
  const points = Array.from({ length: 900 }, random);
  const map = new MapPoints();
  map.add(points, [0, 0, 0]);
  for (let i = 0; i < 200; ++i) {
    const [x, y, z] = [random(), random(), random()];
    let least = kMaxResidual_m;
    for (let p = 0; p < points.length; p += 3) least = Math.min(least, Math.hypot(points[p] - x, points[p + 1] - y, points[p + 2] - z));
    near(map.residual(x, y, z), least);
  }
});

test('tiles around a place are those whose square comes near', () => {
  const tiles = [-2, -1, 0, 1].map((x) => ({ level: 0, x, y: 0 })).concat([{ level: 1, x: 0, y: 0 }]);
  assert.deepEqual(tilesAround(tiles, [1, 5], 10, 20).map((tile) => tile.x), [-1, 0]);
  const bytes = new ArrayBuffer(40);
  new DataView(bytes).setFloat32(20, 7, true);
  assert.deepEqual([...tilePositions(bytes)], [0, 0, 0, 7, 0, 0]);
});

test('lengths are told with the digits that they are worth', () => {
  assert.deepEqual([0.0004, 0.004, 0.0421, 0.42, 3.214, 250.3, null].map(lengthWords),
    ['0.4 mm', '4 mm', '4.2 cm', '42 cm', '3.21 m', '250 m', '–']);
  assert.equal(angleWords(Math.PI / 180), '1.00°');
});

const { DriveRun } = await built('drive_run');
const { kStale_s, lookOf, watchFleet } = await built('fleet');

/** Routes that answer `lost` for every scan and write down what they were asked; `fail` of them throw. */
function fakeRoutes(fail = {}) {
  const asked = [];
  const route = (name, answer) => async (...given) => {
    asked.push([name, ...given].join(' '));
    if (fail[asked.length] !== undefined) throw fail[asked.length];
    return answer(...given);
  };
  return {
    asked,
    open: route('open', () => `s${asked.length}`), send: route('send', (_, scan) => ({ scan })), close: route('close', () => undefined),
  };
}

test('a drive goes through one session, scan by scan, and gives it back', async () => {
  const routes = fakeRoutes();
  const states = [];
  const run = new DriveRun(3, routes, () => states.push(run.state));
  await run.play();
  assert.deepEqual(routes.asked, ['open', 'send s1 0', 'send s1 1', 'send s1 2', 'close s1']);
  assert.deepEqual([run.state, run.answers.length, states.includes('running')], ['done', 3, true]);
});

test('a paused drive stops after the scan under way and goes on from there', async () => {
  const routes = fakeRoutes();
  let pauses = 1;
  const run = new DriveRun(3, routes, () => run.answers.length === 1 && pauses-- > 0 && run.pause());
  await run.play();
  assert.deepEqual([run.state, run.answers.length], ['paused', 1]);
  await run.play();
  assert.deepEqual([run.state, run.answers.length], ['done', 3]);
});

test('after a failure the same scan is sent again; a session that is gone is opened anew', async () => {
  const routes = fakeRoutes({ 3: Object.assign(new Error('down'), {}), 5: Object.assign(new Error('gone'), { status: 404 }) });
  const run = new DriveRun(3, routes, () => undefined);
  await run.play();
  assert.deepEqual([run.state, run.error.message], ['failed', 'down']);
  await run.play();
  assert.deepEqual([run.state, run.error.message], ['failed', 'gone']);
  await run.play();
  assert.deepEqual(routes.asked, ['open', 'send s1 0', 'send s1 1', 'send s1 1', 'send s1 2', 'open', 'send s6 2', 'close s6']);
  assert.deepEqual([run.state, run.error], ['done', undefined]);
});

test('vehicles are asked for every second, less often after failures, and not while nobody looks', async () => {
  const waits = [];
  let next;
  let visible = true;
  const answers = [[], new Error('down'), new Error('down'), []];
  let asked = 0;
  const world = {
    ask: async () => { const answer = answers[asked++]; if (answer instanceof Error) throw answer; return answer; },
    visible: () => visible,
    after: (ms, then) => { waits.push(ms); next = then; return () => { next = undefined; }; },
  };
  const settled = () => new Promise((resolve) => setImmediate(resolve));
  const told = [];
  const watch = watchFleet(world, (list) => told.push(list), (error) => told.push(error.message));
  for (let i = 0; i < 3; ++i) { await settled(); next(); }
  await settled();
  visible = false;
  next();
  await settled();
  assert.deepEqual([waits, told.length, asked], [[1000, 2000, 4000, 1000, 1000], 4, 4]);
  watch.stop();
  assert.equal(next, undefined);
});

test('a vehicle that sends nothing is greyed whatever it said last', () => {
  const vehicle = { status: 'ok', idle_s: 1 };
  assert.equal(lookOf(vehicle), 'ok');
  assert.equal(lookOf({ ...vehicle, idle_s: kStale_s + 1 }), 'stale');
  assert.equal(lookOf({ status: null, idle_s: 99 }), 'new');
});

const { priorAt, usualHeading } = await built('prior');
const { readGnss } = await built('gnss_text');
const { magnification } = await built('magnification');
const { sortDropped } = await built('dropped');

test('a place that was driven past has the height and slope of the drive, others the height of the ground', () => {
  const slope = [0.1, 0, Math.sqrt(1 - 0.01)];
  const poses = [poseWithHeading([0, 0, 5], 0.3, slope), poseWithHeading([200, 0, 9], 2)];
  const beside = priorAt([3, 1, 2], 1, poses);
  assert.deepEqual(beside.position, [3, 1, 5]);
  near(headingOf(beside), 1);
  // The slope is that of the drive: the lidar's upward axis leans towards +x.
  const [x, y, z, w] = beside.quaternion;
  near(2 * (x * z + w * y), 0.1);
  assert.deepEqual(priorAt([90, 0, 2], 1, poses).position.map((value) => Number(value.toFixed(6))), [90, 0, 3.8]);
  near(usualHeading([190, 3, 0], poses), 2);
  assert.equal(usualHeading([0, 0, 0], []), 0);
});

test('a fix is read with its bounds; what was left out or is wrong is said', () => {
  const typed = { latitude: '48.5', longitude: '9', altitude: '', sigma: '3' };
  assert.deepEqual(readGnss(typed), { kind: 'gnss', latitude_deg: 48.5, longitude_deg: 9, altitude_m: null, sigma_m: 3 });
  assert.match(readGnss({ ...typed, latitude: '91' }), /latitude/);
  assert.match(readGnss({ ...typed, longitude: '' }), /longitude/);
  assert.match(readGnss({ ...typed, altitude: 'high' }), /altitude/);
  assert.match(readGnss({ ...typed, sigma: '0' }), /standard deviation/);
});

test('small ellipses are drawn larger by a round number, large ones as they are', () => {
  assert.deepEqual([0.001, 0.02, 0.5, 5].map(magnification), [1000, 50, 2, 1]);
});

test('of a folder the scans are taken in order, with their times', () => {
  const names = ['10.bin', '9.bin', 'times.txt', 'calib.txt', 'a.JPG'].map((name) => ({ name }));
  const { scans, times, others } = sortDropped(names);
  assert.deepEqual([scans.map(({ name }) => name), times.name, others.map(String)], [['9.bin', '10.bin'], 'times.txt', ['calib.txt', 'a.JPG']]);
});

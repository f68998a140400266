import assert from 'node:assert/strict';
import { test } from 'node:test';

const { ramp } = await import('../../../web/dist/unit/scene/colour_maps.js');
const { readViewState, writeViewState } = await import('../../../web/dist/unit/scene/view_state.js');
const { errorForBudget } = await import('../../../web/dist/unit/scene/budget.js');
const { sceneOrigin } = await import('../../../web/dist/unit/scene/scene_origin.js');
const { TileSource } = await import('../../../web/dist/unit/scene/tile_source.js');
const { ApiError } = await import('../../../web/dist/unit/api/errors.js');
const { toGeodetic } = await import('../../../web/dist/unit/scene/geodetic.js');
const { decide, decisionsOf } = await import('../../../web/dist/unit/view/corrections.js');

// Björn Ottosson, "A perceptual color space for image processing", 2020.
function linear(value) {
  const share = value / 255;
  return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
}

function toOklab([red, green, blue]) {
  const [r, g, b] = [linear(red), linear(green), linear(blue)];
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return [
    0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s,
    1.9779984951 * l - 2.428592205 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.808675766 * s,
  ];
}

const difference = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

const kRamps = ['height', 'amount', 'grey', 'quality'];
const kBackgrounds = { dark: [15, 19, 24], light: [244, 246, 248] };

function colours(name, theme, steps = 17) {
  const bytes = ramp(name, steps, theme);
  return Array.from({ length: steps }, (_, i) => [...bytes.subarray(4 * i, 4 * i + 3)]);
}

test('colour maps are perceptually uniform: equal steps look equally far apart', () => {
  for (const theme of ['dark', 'light']) {
    for (const name of kRamps) {
      const labs = colours(name, theme).map(toOklab);
      const steps = labs.slice(1).map((lab, i) => difference(labs[i], lab));
      const mean = steps.reduce((a, b) => a + b) / steps.length;
      for (const step of steps) assert.ok(Math.abs(step - mean) < 0.15 * mean, `${theme} ${name}: ${step} of ${mean}`);
    }
  }
});

test('colour maps can be read without hues, and no colour drowns in the background', () => {
  for (const theme of ['dark', 'light']) {
    for (const name of kRamps) {
      const labs = colours(name, theme).map(toOklab);
      for (const lab of labs) assert.ok(Math.abs(lab[0] - toOklab(kBackgrounds[theme])[0]) > 0.15, `${theme} ${name}`);
      if (name === 'quality') continue;
      const signs = new Set(labs.slice(1).map((lab, i) => Math.sign(lab[0] - labs[i][0])));
      assert.equal(signs.size, 1, `${theme} ${name} turns back`);
    }
  }
});

const kState = {
  eye: [4_000_123.45, -20.5, 30], target: [4_000_100, 0, 1.25], colouring: 'observations', kinds: ['measured', 'filled'],
  overlays: ['loops'], grid: 'coverage', clip: { mode: 'outside', box: { centre: [1, 2, 3], size: [4, 5, 6], yaw: 0.5 } },
};

test('a shared address brings back the whole view', () => {
  const query = new URLSearchParams(writeViewState(kState).toString());
  assert.deepEqual(readViewState(query), kState);
  assert.deepEqual(readViewState(writeViewState({ ...kState, kinds: [], overlays: [] })).kinds, []);
  assert.deepEqual(readViewState(new URLSearchParams('')), {});
});

test('what cannot be read in an address is left out, never believed', () => {
  for (const text of [
    'camera=1,2,3', 'camera=1,2,3,4,5,x', 'camera=1,2,3,4,5,Infinity', 'camera=,,,,,', 'colour=<b>', 'grid=all',
    'clip=inside,1,2,3,0,1,1,0', 'clip=both,1,2,3,1,1,1,0', 'clip=inside,1,2,3,1,1,1', 'camera=1e300,0,0,0,0,0',
  ]) assert.deepEqual(readViewState(new URLSearchParams(text)), {}, text);
});

/** Four children each, down to level 0; every child has as many points as its parent. */
function tree(level) {
  return { level, points: 100, ...(level > 0 && { children: [0, 1, 2, 3].map(() => tree(level - 1)) }) };
}
/** Points drawn when every tile above `error` is refined. */
function drawn(tile, errorOf, error) {
  const own = errorOf(tile);
  if (own === undefined) return 0;
  if (own <= error || tile.children === undefined) return tile.points;
  return tile.children.reduce((sum, child) => sum + drawn(child, errorOf, error), 0);
}

test('the error that is asked for keeps what is drawn within the budget, and uses it', () => {
  const root = tree(4);
  const numbers = new Map();
  const errorOf = (tile) => {
    if (!numbers.has(tile)) numbers.set(tile, numbers.size);
    return 2 ** tile.level * 3 + (numbers.get(tile) % 7) * 0.1;
  };
  for (const budget of [100, 399, 400, 1700, 5000, 20_000]) {
    const error = errorForBudget(root, errorOf, budget, 1);
    const points = drawn(root, errorOf, error);
    assert.ok(points <= Math.max(budget, 100), `${points} of ${budget}`);
    assert.ok(points >= Math.min(budget / 4, 100 * 4 ** 4), `${points} of ${budget}`);
  }
});

test('nothing finer than the screen is asked for, and nothing for what is out of the picture', () => {
  const root = tree(4);
  assert.equal(errorForBudget(root, ({ level }) => 2 ** level, 1e9, 5), 5);
  assert.equal(errorForBudget(root, () => undefined, 1, 1.2), 1.2);
  assert.throws(() => errorForBudget(root, () => 1, 0, 1), /budget: 0/);
});

test('one that only groups others costs nothing, and a coarsest level above the budget is drawn all the same', () => {
  const group = { level: 9, points: 0, children: [tree(1), tree(1)] };
  const errorOf = ({ level }) => 10 * level;
  assert.equal(drawn(group, errorOf, errorForBudget(group, errorOf, 50, 1)), 200);
});

const refusal = (status) => new ApiError('problem', `status ${status}`, { status });
const down = () => new ApiError('down', 'nobody answers');
const body = (text) => new Response(text);

test('a server that comes back within the tries is not spoken of', async () => {
  let asked = 0;
  const told = [];
  const source = new TileSource(async () => {
    if (++asked < 3) throw down();
    return body('abc');
  }, (trouble) => told.push(trouble), [1, 1]);
  assert.equal((await source.bytes('/t', new AbortController().signal)).byteLength, 3);
  assert.deepEqual([asked, told], [3, []]);
});

/** A source that never answers but with what `answer` throws, and the first trouble it tells of. */
function failing(answer) {
  const asked = [];
  const told = [];
  let tell;
  const first = new Promise((resolve) => (tell = resolve));
  const source = new TileSource(async (url) => {
    asked.push(url);
    return answer();
  }, (trouble) => {
    told.push(trouble?.kind);
    tell();
  }, [1, 1]);
  return { source, asked, told, first };
}
const turns = async (count) => {
  for (let i = 0; i < count; ++i) await new Promise((resolve) => setTimeout(resolve, 1));
};

test('when nobody answers all requests wait, one word is said, and retry goes on with all', async () => {
  let up = false;
  const { source, asked, told, first } = failing(() => {
    if (!up) throw down();
    return body('abc');
  });
  const { signal } = new AbortController();
  const tiles = [1, 2, 3, 4].map((n) => source.bytes(`/${n}`, signal));
  await first;
  assert.ok(asked.length <= 12, `${asked.length} requests`);
  const before = asked.length;
  await turns(20);
  assert.equal(asked.length, before, 'nothing is asked while all wait');
  up = true;
  source.retry();
  assert.equal((await Promise.all(tiles)).length, 4);
  assert.deepEqual(told, ['offline', undefined]);
});

test('a deleted map, a missing key, a refusal and a busy server are told apart, and not asked again', async () => {
  const kinds = [[404, 'gone'], [503, 'busy'], [403, 'refused'], [500, 'refused'], [401, 'key']];
  for (const [status, kind] of kinds) {
    const { source, asked, told, first } = failing(() => {
      throw status === 401 ? new ApiError('key', 'none was given', { status }) : refusal(status);
    });
    const stop = new AbortController();
    const waiting = source.bytes('/t', stop.signal);
    await first;
    await turns(10);
    assert.deepEqual([asked.length, told], [1, [kind]]);
    stop.abort();
    await assert.rejects(waiting, { name: 'AbortError' });
  }
});

test('map coordinates become the place on the ellipsoid', () => {
  // Truth: GeographicLib's CartConvert -l 49 8.4 115.
  const origin = { latitude_deg: 49, longitude_deg: 8.4, altitude_m: 115 };
  const at = toGeodetic([0, 0, 0], origin);
  assert.ok(Math.abs(at.latitude_deg - 49) < 1e-9 && Math.abs(at.longitude_deg - 8.4) < 1e-9 && Math.abs(at.altitude_m - 115) < 1e-4);
});

const kCar = { number: 3, class: 'car', places: [{ centre: [1, 2, 0], size: [4, 2, 1], yaw: 0 }, { centre: [5, 2, 0], size: [4, 2, 1], yaw: 0 }] };

test('a decision about an object replaces the one before and leaves the others', () => {
  const region = { action: 'remove', box: { centre: [0, 0, 0], size: [1, 1, 1], yaw: 0 } };
  const first = decide([region], kCar, 'keep');
  assert.deepEqual(first, [region, { action: 'keep', object: { centre: [5, 2, 0], class: 'car' } }]);
  assert.deepEqual(decide(first, kCar, 'remove').map(({ action }) => action), ['remove', 'remove']);
  assert.deepEqual(decide(first, kCar, undefined), [region]);
  assert.deepEqual([...decisionsOf(first, [kCar])], [[3, 'keep']]);
  assert.equal(decisionsOf([{ action: 'keep', object: { centre: [5, 2, 0], class: 'van' } }], [kCar]).size, 0);
});

test('a picture has its origin amid the points, however far these are from the origin of the map', () => {
  const bounds = { min: [1_000_000, -40, 3], max: [1_000_220, 99.5, 4] };
  assert.deepEqual(sceneOrigin([100.25, 200, 7], bounds), [1_000_210.25, 230, 7]);
  assert.deepEqual(sceneOrigin([1, 2, 3], undefined), [1, 2, 3]);
});

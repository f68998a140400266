import assert from 'node:assert/strict';
import { beforeEach, test } from 'node:test';

const unit = (name) => import(`../../../web/dist/unit/${name}.js`);
const { addressOf, ask } = await unit('api/client');
const { listTiles } = await unit('api/tiles');
const { answerKey, askForKey, keyWanted, setKey } = await unit('api/keys');
const { answered, busy, connection, watch } = await unit('api/connection');
const { parsePlace, linkTo, place, replaceQuery } = await unit('state/router');

/** Answers in turn, and what was asked. */
function serve(...answers) {
  const asked = [];
  globalThis.fetch = async (url, init) => {
    asked.push({ url, key: init?.headers?.Authorization, method: init?.method });
    const answer = answers.shift();
    if (answer === undefined) throw new TypeError('fetch failed');
    return answer;
  };
  return asked;
}
const json = (body, status = 200, headers = {}) =>
  new Response(JSON.stringify(body), { status, headers: { 'content-type': 'application/json', ...headers } });
const problem = (status, code, headers = {}) => new Response(
  JSON.stringify({ title: 'refused', detail: 'because', code, request_id: 'r1', errors: [] }),
  { status, headers: { 'content-type': 'application/problem+json', ...headers } });

beforeEach(() => {
  setKey(undefined);
  connection.set({ state: 'up' });
});

test('names and queries are escaped, and what is not given is left out', () => {
  const url = addressOf('/v1/maps/{map}/versions/{version}', { map: 'a/b', version: 'v 1' }, { x: undefined, y: 'ü', z: 0 });
  assert.equal(url, '/v1/maps/a%2Fb/versions/v%201?y=%C3%BC&z=0');
  assert.throws(() => addressOf('/v1/maps/{map}', {}), /no value for \{map\}/);
});

test('tiles of an area come part by part, until there are enough points', async () => {
  const tile = (x, points) => ({ level: 0, x, y: 0, points, min: [0, 0, 0], max: [1, 1, 1] });
  const parts = () => [json({ tiles: [tile(2, 10), tile(1, 10)], next: 7 }), json({ tiles: [tile(0, 5)], next: null })];
  const place = { map: 'town', version: 'v 1' };
  const signal = new AbortController().signal;
  let asked = serve(...parts());
  const found = await listTiles(place, { min: [-1.5, -2], max: [3, 4] }, signal);
  assert.deepEqual(found.map(({ x }) => x), [2, 1, 0]);
  const path = '/v1/maps/town/versions/v%201/tiles?limit=1000';
  assert.deepEqual(asked.map(({ url }) => url), [
    `${path}&area=-1.500%2C-2.000%2C3.000%2C4.000`, `${path}&before=7&area=-1.500%2C-2.000%2C3.000%2C4.000`]);
  asked = serve(...parts());
  assert.equal((await listTiles(place, undefined, signal, 19)).length, 2);
  assert.deepEqual(asked.map(({ url }) => url), [path]);
});

test('an address comes back as it went', () => {
  const link = linkTo('view', ['a/b', 'v 1'], { eye: '1,2' });
  const { view, path, query } = parsePlace(link);
  assert.deepEqual([view, path, query.get('eye')], ['view', ['a/b', 'v 1'], '1,2']);
  assert.deepEqual(parsePlace('').path, []);
  assert.deepEqual(parsePlace('#/a/%E0').path, ['%E0']);
});

test('a view keeps its state in its own address, never in that of another which the window has gone to', (t) => {
  t.mock.timers.enable({ apis: ['setTimeout'] });
  const written = [];
  globalThis.window = { location: { hash: '#/compare/town/v1/v2' }, history: { replaceState: (_state, _title, link) => written.push(link) } };
  place.set(parsePlace(window.location.hash));
  replaceQuery({ split: '40' });
  replaceQuery({ split: '50' });
  t.mock.timers.tick(1000);
  assert.deepEqual(written, ['#/compare/town/v1/v2?split=50']);
  replaceQuery({ split: '60' });
  window.location.hash = '#/localize/town';  // its `hashchange` comes later
  t.mock.timers.tick(1000);
  assert.equal(written.length, 1);
  delete globalThis.window;
});

test('a refusal is an error with the server’s words and code', async () => {
  serve(problem(404, 'UnknownMap'));
  const error = await ask('get', '/v1/maps/{map}', { path: { map: 'x' } }).catch((caught) => caught);
  assert.equal(error.code, 'UnknownMap');
  assert.equal(error.status, 404);
  assert.match(error.message, /Refused: because/);
  assert.equal(error.requestId, 'r1');
});

test('what was asked goes on with the key that a person gives', async () => {
  const asked = serve(problem(401, 'MissingKey'), problem(401, 'RefusedKey'), json({ maps: [] }));
  const reasons = [];
  const unlisten = keyWanted.listen((reason) => {
    if (reason === undefined) return;
    reasons.push(reason);
    setTimeout(() => answerKey(reason === 'MissingKey' ? 'wrong' : 'right'));
  });
  const { data } = await ask('get', '/v1/maps');
  unlisten();
  assert.deepEqual(data, { maps: [] });
  assert.deepEqual(reasons, ['MissingKey', 'RefusedKey']);
  assert.deepEqual(asked.map(({ key }) => key), [undefined, 'Bearer wrong', 'Bearer right']);
});

test('requests that wait for a key share one dialog, and fail together when it is closed', async () => {
  serve(problem(401, 'MissingKey'), problem(401, 'MissingKey'));
  const both = Promise.allSettled([ask('get', '/v1/maps'), ask('get', '/v1/jobs')]);
  await new Promise((resolve) => setTimeout(resolve, 10));
  answerKey(undefined);
  for (const { reason } of await both) assert.equal(reason.trouble, 'key');
});

test('a key that is known to be refused is not asked with again, and a closed dialog stays closed until the person wants it', async () => {
  const asked = serve(problem(401, 'RefusedKey'), json({ maps: [] }), json({ jobs: [] }));
  setKey('revoked');
  let opened = 0;
  const unlisten = keyWanted.listen((reason) => (opened += reason === undefined ? 0 : 1));
  const first = ask('get', '/v1/maps').catch((error) => error);
  await new Promise((resolve) => setTimeout(resolve, 5));
  const second = ask('get', '/v1/maps').catch((error) => error);
  const stop = new AbortController();
  const left = ask('get', '/v1/maps', { signal: stop.signal });
  stop.abort();
  await assert.rejects(left, { name: 'AbortError' });
  answerKey(undefined);
  for (const error of await Promise.all([first, second])) assert.match(error.message, /revoked or expired/);
  await assert.rejects(ask('get', '/v1/maps'), { trouble: 'key' });
  assert.deepEqual([asked.length, opened], [1, 1], 'asked once, opened once');
  askForKey();
  assert.equal(opened, 2);
  const waits = ask('get', '/v1/maps');
  answerKey('another');
  assert.deepEqual((await waits).data, { maps: [] });
  assert.equal(asked.at(-1).key, 'Bearer another');
  assert.equal((await ask('get', '/v1/jobs')).status, 200);
  unlisten();
});

test('a busy server is asked again when it said so, and not for ever', async () => {
  const later = () => problem(503, 'Busy', { 'retry-after': '0' });
  const asked = serve(later(), later(), json({ maps: [] }));
  assert.equal((await ask('get', '/v1/maps')).status, 200);
  assert.equal(asked.length, 3);
  serve(later(), later());
  await assert.rejects(ask('get', '/v1/maps', { patience: 1 }), { code: 'Busy' });
  serve(problem(503, 'MapUnusable'));
  await assert.rejects(ask('get', '/v1/maps'), { code: 'MapUnusable' });
});

test('what is being made is waited for as long as it takes', async () => {
  const made = () => problem(503, 'BeingMade', { 'retry-after': '0' });
  const asked = serve(made(), made(), made(), json({ maps: [] }));
  assert.equal((await ask('get', '/v1/maps', { patience: 1 })).status, 200);
  assert.equal(asked.length, 4);
  serve(made());
  await assert.rejects(ask('get', '/v1/maps', { patience: 0 }), { code: 'BeingMade' });
});

test('a request that takes long is said, also while the page waits for a server that was busy', (t) => {
  t.mock.timers.enable({ apis: ['setTimeout'] });
  const ended = watch();
  busy(1, 'is being made');
  t.mock.timers.tick(3999);
  assert.equal(connection.get().state, 'busy');
  t.mock.timers.tick(1);
  assert.equal(connection.get().state, 'slow');
  answered();
  assert.equal(connection.get().state, 'slow');
  ended();
  assert.equal(connection.get().state, 'up');
});

test('no answer, a late answer and an unreadable answer are told apart', async () => {
  serve();
  await assert.rejects(ask('get', '/v1/maps'), { trouble: 'down' });
  assert.equal(connection.get().state, 'down');
  serve(json({}));
  await ask('get', '/v1/maps');
  assert.equal(connection.get().state, 'up');
  globalThis.fetch = (_, init) => new Promise((_resolve, reject) => {
    init.signal.addEventListener('abort', () => reject(init.signal.reason));
  });
  await assert.rejects(ask('get', '/v1/maps', { timeoutS: 0.01 }), { trouble: 'late' });
  const stop = new AbortController();
  const asking = ask('get', '/v1/maps', { signal: stop.signal });
  stop.abort();
  await assert.rejects(asking, { name: 'AbortError' });
  serve(new Response('<html>', { headers: { 'content-type': 'application/json' } }));
  await assert.rejects(ask('get', '/v1/maps'), { trouble: 'garbled' });
});

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { createHash } from 'node:crypto';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { gzipSync } from 'node:zlib';

const unit = (name) => import(`../../../web/dist/unit/${name}.js`);
const { tarOf, tarNames } = await unit('upload/tar');
const { lookAt, lookAtFolder } = await unit('upload/kind');
const { chosenFile } = await unit('upload/chosen');
const { cut, missing, partBytesFor, partBytesOf, Speed } = await unit('upload/parts');
const { faultOfName, suggestedMap, suggestedVersion } = await unit('upload/names');
const { Transfer } = await unit('upload/transfer');
const { contentDigest, hex, sha256 } = await unit('upload/digest');
const { ApiError, down } = await unit('api/errors');
const { connection } = await unit('api/connection');

const named = (name, content) => Object.assign(new Blob([content]), { name, lastModified: 1_700_000_000_000 });
const kMiB = 1 << 20;
/** The head of a LAS file, with the number of its point format. */
const las = (format) => Buffer.concat([Buffer.from('LASF'), Buffer.alloc(100), Buffer.from([format]), Buffer.alloc(270)]);

test('tar reads what we pack: long paths, other letters, empty files', async () => {
  const long = `${'folder/'.repeat(20)}scan.bin`;
  const files = [['b.txt', 'second'], ['a.txt', 'x'.repeat(512)], [long, 'deep'], ['größe.txt', 'ß'], ['empty', '']];
  const tar = tarOf(files.map(([path, content]) => ({ path, file: named(path, content) })));
  const folder = mkdtempSync(join(tmpdir(), 'tar-'));
  writeFileSync(join(folder, 'all.tar'), Buffer.from(await tar.arrayBuffer()));
  const { status, stderr } = spawnSync('tar', ['xf', 'all.tar'], { cwd: folder, encoding: 'utf8' });
  assert.equal(status, 0, stderr);
  for (const [path, content] of files) assert.equal(readFileSync(join(folder, path), 'utf8'), content);
  rmSync(folder, { recursive: true });
  assert.deepEqual(await tarNames(tar, 10), [...files.map(([path]) => path)].sort());
});

test('the same files give the same bytes, in whatever order they come', async () => {
  const entries = ['c', 'a', 'b'].map((path) => ({ path, file: named(path, path) }));
  const bytes = async (list) => Buffer.from(await tarOf(list).arrayBuffer());
  assert.deepEqual(await bytes(entries), await bytes([...entries].reverse()));
});

test('a file is told by what is in it, not by its name', async () => {
  const tar = async (...paths) => Buffer.from(await tarOf(paths.map((path) => ({ path, file: named(path, 'x') }))).arrayBuffer());
  const kinds = [
    ['x', '# .PCD v0.7\nVERSION 0.7\n', 'pcd'], ['x', 'ply\nformat ascii 1.0\n', 'ply'], ['x', las(6), 'las'],
    ['x', await tar('./manifest.json', './tiles/0_0_0.bin'), 'package'], ['x', await tar('monday/velodyne/000000.bin'), 'drive'],
    ['x', gzipSync(await tar('map/manifest.json')), 'package'], ['x', gzipSync(await tar('velodyne/000000.bin')), 'drive'],
  ];
  for (const [name, content, kind] of kinds) assert.deepEqual([(await lookAt(named(name, content))).kind], [kind]);
  assert.equal((await lookAt(named('x.tar.zst', new Uint8Array([0x28, 0xb5, 0x2f, 0xfd])))).sure, false);
});

test('a recording is a drive by itself, packed as a tar', async () => {
  for (const name of ['run.mcap', 'run.db3', 'run.rawlog', 'run.mcap.zstd', 'run.bag', 'RUN.MCAP']) {
    const { content, look } = await chosenFile(named(name, 'x'));
    assert.deepEqual([look.kind, look.sure, await tarNames(content, 10)], ['drive', true, [name]]);
  }
  assert.match((await chosenFile(named('run.mcap', ''))).look.refused, /empty/);
});

test('what the server would not take is said before a byte is sent', async () => {
  const refusals = [
    ['map.zip', 'PK\u0003\u0004', /zip/], ['a.las', las(6 | 0x80), /LAZ.*unpack/], ['a.las', 'SALF', /start with LASF.*export/], ['x.tar', '', /empty/], ['notes.txt', 'hello', /unknown: choose a tar/],
    ['x.gz', gzipSync('no tar'), /does not contain a tar.*drop the folder/], ['scan.bin', 'xxxx', /single scan/],
  ];
  for (const [name, content, words] of refusals) assert.match((await lookAt(named(name, content))).refused, words);
  assert.match(lookAtFolder('holiday', ['beach.jpg']).refused, /neither a map package.*nor scans/);
  assert.equal(lookAtFolder('day', ['velodyne/0.bin']).kind, 'drive');
  assert.equal(lookAtFolder('day', ['metadata.yaml', 'day_0.db3.zstd']).kind, 'drive');
});

test('parts cover the file once, and there are at most 10000', () => {
  for (const size of [1, 8 * kMiB, 8 * kMiB + 1, 300 * 1024 ** 3]) {
    const parts = cut(size, partBytesFor(size));
    assert.ok(parts.length <= 10_000);
    assert.equal(parts[0].begin, 0);
    assert.equal(parts.at(-1).end, size);
    parts.slice(1).forEach((part, i) => assert.equal(part.begin, parts[i].end));
  }
  assert.deepEqual(cut(0, kMiB), []);
});

test('how a file was cut is seen from the parts that are there', () => {
  const part = (n, bytes) => ({ n, bytes, sha256: '' });
  const size = 20 * kMiB + 5;
  assert.equal(partBytesOf([], size), 8 * kMiB);
  assert.equal(partBytesOf([part(1, 8 * kMiB)], size), 8 * kMiB);
  assert.equal(partBytesOf([part(3, 4 * kMiB + 5)], size), 8 * kMiB);
  assert.equal(partBytesOf([part(1, 3 * kMiB), part(7, 2 * kMiB + 5)], size), 3 * kMiB);
  assert.equal(partBytesOf([part(1, 8 * kMiB), part(2, 7)], size), undefined);
  assert.equal(partBytesOf([part(4, 8 * kMiB)], size), undefined);
  assert.deepEqual(missing(cut(size, 8 * kMiB), [part(2, 8 * kMiB)]).map(({ n }) => n), [1, 3]);
});

test('names are as the server takes them, and suggestions are such names', () => {
  for (const name of ['town', 'a.b_c-1', 'x'.repeat(63)]) assert.equal(faultOfName(name), undefined);
  for (const name of ['', 'Town', '-a', 'x'.repeat(64), 'a b', 'ä']) assert.notEqual(faultOfName(name), undefined);
  for (const file of ['My Town.tar.gz', '---.pcd', 'Straße 7', '.tar']) assert.equal(faultOfName(suggestedMap(file)), undefined);
  assert.equal(suggestedVersion(['v1', 'v9', 'other']), 'v10');
  assert.equal(suggestedVersion([]), 'v1');
});

test('speed is that of the last seconds', () => {
  const speed = new Speed();
  assert.equal(speed.bytesPerS, undefined);
  for (let s = 0; s <= 20; ++s) speed.note(1000 * s, 100 * s);
  assert.equal(speed.bytesPerS, 100);
  for (let s = 21; s <= 40; ++s) speed.note(1000 * s, 2000 + 300 * (s - 20));
  assert.equal(speed.bytesPerS, 300);
});

/**
 * A server of parts in memory. @param before is called before each request with its name, and may throw
 * @param slow parts that take longer than others
 */
function memory(before = () => undefined, slow = []) {
  const parts = new Map();
  const listed = () => [...parts].map(([n, bytes]) => ({ n, bytes: bytes.length, sha256: createHash('sha256').update(bytes).digest('hex') }));
  return {
    parts,
    asked: [],
    begin: async function () { this.asked.push('begin'); before('begin'); return listed(); },
    put: async function (n, body, digest, onProgress) {
      this.asked.push(n);
      before(n);
      assert.equal(digest, contentDigest(await sha256(body)));
      onProgress(body.byteLength);
      if (slow.includes(n)) await new Promise((resolve) => setTimeout(resolve, 200));
      parts.set(n, Buffer.from(body));
    },
    finish: async function () { before('finish'); return { is: 'drive', drive: 1 }; },
    discard: async () => parts.clear(),
    whole: () => Buffer.concat([...parts].sort(([a], [b]) => a - b).map(([, bytes]) => bytes)),
  };
}
const kContent = Buffer.concat([1, 2, 3, 4].map((n) => Buffer.alloc(n < 4 ? 8 * kMiB : 100, `part ${n} `)));

test('a file arrives as it is', async () => {
  const target = memory();
  const transfer = new Transfer(new Blob([kContent]), target);
  await transfer.run();
  assert.equal(transfer.view.get().state, 'done');
  assert.ok(target.whole().equals(kContent));
});

test('an upload goes on after the server was away, and sends only what broke off twice', async () => {
  let away = 1;
  const target = memory((what) => {
    if (what !== 3 || away-- <= 0) return;
    connection.set({ state: 'down' });
    setTimeout(() => connection.set({ state: 'up' }), 20);
    throw down();
  }, [1, 2]);
  const transfer = new Transfer(new Blob([kContent]), target);
  const states = [];
  transfer.view.listen(({ state }) => states.at(-1) !== state && states.push(state));
  await transfer.run();
  assert.equal(states.at(-1), 'done');
  assert.ok(states.includes('waiting'), states.join());
  assert.ok(target.whole().equals(kContent));
  // Parts 1 and 2 were still under way when 3 broke off.
  assert.deepEqual(target.asked.filter((what) => what !== 'begin').sort(), [1, 2, 3, 3, 4]);
});

test('another file is not mixed with what was begun', async () => {
  const target = memory();
  target.parts.set(1, Buffer.alloc(8 * kMiB, 'of another file'));
  const transfer = new Transfer(new Blob([kContent]), target);
  await transfer.run();
  assert.equal(transfer.view.get().state, 'failed');
  assert.match(transfer.view.get().error.message, /another file/);
  assert.deepEqual(target.asked, ['begin']);
});

test('a refusal ends it in the server’s words, and it can be tried again', async () => {
  let refuse = true;
  const target = memory((what) => {
    if (what === 'finish' && refuse) throw new ApiError('problem', 'Not a drive: no scans.', { status: 422 });
  });
  const transfer = new Transfer(new Blob([kContent]), target);
  await transfer.run();
  assert.equal(transfer.view.get().error.message, 'Not a drive: no scans.');
  refuse = false;
  await transfer.run();
  assert.equal(transfer.view.get().state, 'done');
});

for (const [when, isThen] of [['the first part', (what) => what !== 'begin'], ['the last part', (_, asked) => asked === 5]]) {
  test(`a pause during ${when} sends nothing more until it goes on`, async () => {
    let transfer;
    let isToPause = true;
    let asked;
    const target = memory((what) => {
      if (!isToPause || !isThen(what, target.asked.length)) return;
      isToPause = false;
      transfer.pause();
      asked = target.asked.length;
    });
    transfer = new Transfer(new Blob([kContent]), target);
    await transfer.run();
    assert.equal(transfer.view.get().state, 'paused');
    await new Promise((resolve) => setTimeout(resolve, 100));
    assert.equal(target.asked.length, asked);
    await transfer.run();
    assert.equal(transfer.view.get().state, 'done');
    assert.ok(target.whole().equals(kContent));
  });
}

test('bytes are written in hexadecimal digits', () => assert.equal(hex(new Uint8Array([0, 255])), '00ff'));

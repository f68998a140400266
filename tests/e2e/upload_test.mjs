// Uploads: a package, a drive that breaks off in every way and goes on, a folder, and what is refused.

import { execFileSync } from 'node:child_process';
import { readFileSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { main } from './harness.mjs';

const kPart = 8 * 1024 * 1024;
/** How many parts the page has under way at most. */
const kPartsAtOnce = 3;
const chooser = (page) => page.locator('dialog input[type=file]').first();
const get = async (server, path) => (await fetch(`${server.origin}${path}`)).json();

/** Opens the dialog on a map's page and chooses a file, or a folder. */
async function choose(page, path, folder = false) {
  await page.locator('.heading').first().getByRole('button', { name: 'Upload' }).click();
  await (folder ? page.locator('dialog input[type=file]').nth(1) : chooser(page)).setInputFiles(path);
}

const partOf = (url) => Number(/parts\/(\d+)$/.exec(url)?.[1] ?? 0);

/** Numbers of the parts that the page sends, and of those that it was told are stored, as they come. */
function watchParts(page) {
  const [sent, stored] = [[], []];
  const isPart = (request) => request.method() === 'PUT' && partOf(request.url()) > 0;
  page.on('request', (request) => isPart(request) && sent.push(partOf(request.url())));
  page.on('response', (response) => response.ok() && isPart(response.request()) && stored.push(partOf(response.url())));
  return { sent, stored };
}

/** The server stands still before the first part from `n` on reaches it, so that it stores none of these. @return when one is on its way */
async function standStillAt(page, server, n) {
  const late = (url) => partOf(url.href) >= n;
  await new Promise((resolve) => page.route(late, (route) => {
    server.process.kill('SIGSTOP');
    resolve(route.continue());
  }));
  await page.unroute(late);
}

async function packages(run) {
  run.expectedErrors = [];
  const server = await run.server({ empty: true });
  const page = await run.open(server);
  await page.waitForSelector('text=No maps yet');
  await page.getByRole('button', { name: 'Upload' }).click();
  await chooser(page).setInputFiles({ name: 'town.zip', mimeType: 'application/zip', buffer: Buffer.from('PK\u0003\u0004') });
  run.expect(/zip archives are not supported/.test(await page.locator('dialog .trouble').innerText()), 'a zip is refused before it is sent');
  await run.screenshot(page, 'upload_refused');
  await chooser(page).setInputFiles(run.tar('map', 'Town Centre.tar'));
  await page.waitForSelector('dialog :text("Map package")');
  await run.accessible(page, 'the upload dialog');
  run.expect(await page.inputValue('dialog input[list]') === 'town-centre', 'a name is suggested');
  await page.fill('dialog input[list]', 'centre');
  await run.screenshot(page, 'upload');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.upload.done');
  await page.waitForSelector('tr[data-map=centre]');
  run.expect((await get(server, '/v1/maps/centre/versions')).versions[0].version === 'v1', 'a package becomes a version');
  await packageGoesOn(run, server, page);

  await dropText(page, 'points.pcd', `VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n1 2 3\n`);
  await page.waitForSelector('dialog :text("PCD")');
  await page.fill('dialog input[list]', 'broken');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.notice a:has-text("Job"), .upload.failed');
  run.expect(true, 'a PCD map that was dropped on the page is sent');
  await page.context().close();
  await server.stop();
}

/** A package whose second part stands still, is left by a reload, and goes on from the map's page. */
async function packageGoesOn(run, server, page) {
  await page.goto(`${server.origin}/#/maps/centre`);
  const held = new Promise((resolve) => page.route(/parts\/2$/, resolve));
  page.on('dialog', (dialog) => dialog.accept());
  await choose(page, run.tar('map', 'again.tar'));
  await page.click('dialog button[type=submit]');
  await held;
  await page.locator('.upload.sending').getByRole('button', { name: 'Pause' }).click();
  await page.unroute(/parts\/2$/);
  await page.reload();
  await page.waitForSelector('[data-upload] >> text=Resume the upload');
  await page.click('text=Resume the upload');
  await chooser(page).setInputFiles(run.tar('map', 'again.tar'));
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.upload.done');
  await page.waitForSelector('tr[data-version=v2]');
  run.expect(true, 'a package goes on after a reload too');
  await page.goto(`${server.origin}/#/maps`);
  await page.waitForSelector('tr[data-map=centre]');
}

/** Drops a text file on the page, as a file manager would. */
async function dropText(page, name, text) {
  const transfer = await page.evaluateHandle(([file, content]) => {
    const dropped = new DataTransfer();
    dropped.items.add(new File([content], file));
    return dropped;
  }, [name, text]);
  for (const type of ['dragenter', 'dragover', 'drop']) await page.dispatchEvent('body', type, { dataTransfer: transfer });
}

async function interrupted(run) {
  const server = await run.server();
  const tar = run.tar('drive', 'monday.tar');
  const count = Math.ceil(statSync(tar).size / kPart);
  const page = await run.open(server, '#/maps/town');
  await page.waitForSelector('h2:text-is("Drives")');
  const { sent, stored } = watchParts(page);
  // The server dies while the fifth part is under way, and comes back.
  const died = standStillAt(page, server, 5).then(() => server.stop('SIGKILL'));
  await choose(page, tar);
  await page.waitForSelector('dialog :text("Drive")');
  await page.click('dialog button[type=submit]');
  await died;
  await page.waitForSelector('.upload.waiting');
  run.expect(/continues when the server answers/.test(await page.locator('.upload').innerText()), 'a server that dies is said, and waited for');
  await run.screenshot(page, 'upload_waiting');
  const [before, kept] = [sent.length, [...stored]];
  await server.start();
  await page.waitForSelector('.upload.done');
  const drive = (await get(server, '/v1/maps/town/drives')).drives[0];
  run.expect(drive.status === 'complete' && drive.bytes === statSync(tar).size, 'the drive is complete');
  // What was under way is sent once more, unless it was stored and only the answer was lost; nothing else is.
  const again = sent.slice(before);
  run.expect(before <= 4 + kPartsAtOnce && sent.length <= count + kPartsAtOnce && new Set(again).size === again.length
    && !again.some((n) => kept.includes(n)), `${count} parts: ${sent.slice(0, before)}, then ${again}; told to be stored: ${kept}`);
  await page.waitForSelector(`tr[data-drive="${drive.id}"] >> text="Complete"`);
  await server.stop();
}

async function reloaded(run) {
  const server = await run.server();
  const tar = run.tar('drive', 'tuesday.tar');
  const count = Math.ceil(statSync(tar).size / kPart);
  const page = await run.open(server, '#/maps/town');
  page.on('dialog', (dialog) => dialog.accept());
  await page.waitForSelector('h2:text-is("Drives")');
  // The server stands still while the fifth part is under way, so that there is time to look.
  const before = watchParts(page);
  const fifth = standStillAt(page, server, 5);
  await choose(page, tar);
  await page.click('dialog button[type=submit]');
  await fifth;
  await page.waitForSelector('.upload.sending');
  run.expect(/MB of .* MB/.test(await page.locator('.upload').innerText()), 'how far it is is told');
  await run.screenshot(page, 'upload_sending');
  await page.getByRole('button', { name: 'Pause' }).click();
  await page.waitForSelector('.upload.paused');
  run.expect(true, 'it pauses');
  const known = [...before.stored];
  server.process.kill('SIGCONT');
  await page.reload();
  await page.waitForSelector('tr[data-drive="1"] >> text=Incomplete');
  run.expect(/\d+ % of/.test(await page.locator('tr[data-drive="1"]').innerText()), 'after a reload the share that is there is told');
  await page.getByRole('button', { name: 'Resume the upload' }).click();
  await chooser(page).setInputFiles(run.tar('map', 'other.tar'));
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.upload.failed:has-text("another file")');
  run.expect(true, 'another file is refused before any of it is sent');
  const there = (await get(server, '/v1/maps/town/drives/1')).parts.map(({ n }) => n);
  const { sent } = watchParts(page);
  await page.getByRole('button', { name: 'Resume the upload' }).click();
  await chooser(page).setInputFiles(tar);
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.upload.done');
  // Of those under way at the reload, none to all are there.
  const all = [...there, ...sent].sort((a, b) => a - b);
  run.expect(known.every((n) => there.includes(n)) && all.length === count && all.every((n, i) => n === i + 1),
    `${there} of ${count} parts are there, the page knew of ${known}; after the reload ${sent} are sent, each once`);
  run.expect((await get(server, '/v1/maps/town/drives')).drives[0].status === 'complete', 'the drive is complete');
  await server.stop();
}

async function folder(run) {
  const server = await run.server();
  const page = await run.open(server, '#/maps/town');
  await choose(page, join(run.sample, 'drive'), true);
  await page.waitForSelector('dialog :text("files")');
  await page.fill('dialog .field:has-text("Name of the drive") input', 'from a folder');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.upload.done');
  const drive = (await get(server, '/v1/maps/town/drives')).drives[0];
  run.expect(drive.status === 'complete' && drive.name === 'from a folder', 'a folder is packed by the page, and is a drive to the server');
  await page.getByRole('button', { name: 'Delete the drive from a folder' }).click();
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('tr[data-drive]', { state: 'detached' });
  run.expect(true, 'a drive is deleted');
  const seeds = join(run.scratch, 'seeds');
  execFileSync('python3', ['-B', fileURLToPath(new URL('../fuzz/seeds.py', import.meta.url)), seeds]);
  const bag = readFileSync(join(seeds, 'mcap', 'seed_indexed_zstd'));
  await choose(page, { name: 'run.mcap', mimeType: 'application/octet-stream', buffer: bag });
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('tr[data-drive]:has-text("run") >> text="Complete"');
  run.expect(true, 'a bag in one file is a drive');
  await server.stop();
}

async function refused(run) {
  const server = await run.server({ options: ['--uploads-max-drive-bytes', '20000000'] });
  const page = await run.open(server, '#/maps/town');
  await choose(page, run.tar('drive', 'large.tar'));
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.upload.failed');
  const words = await page.locator('.upload.failed').innerText();
  run.expect(/20000000/.test(words), `413 names the limit: ${words.replace(/\s+/g, ' ')}`);
  await page.getByRole('button', { name: 'Close large.tar' }).click();
  await page.waitForSelector('.upload', { state: 'detached' });
  await choose(page, brokenOff(run));
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.upload.failed');
  const why = await page.locator('.upload.failed').innerText();
  run.expect(/truncated|archive|ends/i.test(why), `422 says what is wrong with it: ${why.replace(/\s+/g, ' ')}`);
  await server.stop();
}

/** The first megabyte of a drive, as a copy that broke off leaves it. @return its path */
function brokenOff(run) {
  const path = join(run.scratch, 'broken.tar');
  writeFileSync(path, readFileSync(run.tar('drive')).subarray(0, 1_000_000));
  return path;
}

await main({ packages, interrupted, reloaded, folder, refused });

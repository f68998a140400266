// The page from end to end, as a map team uses it: a drive is uploaded, a version rebuilt of it and watched, compared
// with the one before, published and rolled back, and a scan found in it.

import { readdirSync, readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { gzipSync } from 'node:zlib';
import { main } from './harness.mjs';
import { drop, json, scanOf, shown, until } from './support.mjs';

const kMostScriptBytes = 400_000;
/** A rebuild of the sample drive on a machine that does other things too. */
const kRebuildMs = 240_000;

async function upload(run, page) {
  await page.click('.top a:text-is("Maps")');
  await page.click('a:text-is("town")');
  await page.click('button:has-text("Upload")');
  await page.setInputFiles('dialog input[type=file] >> nth=0', run.tar('drive', 'monday.tar'));
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'tr[data-drive]:has-text("Complete")', 'an uploaded drive is listed as complete', { timeout: kRebuildMs });
}

async function rebuild(run, page, server) {
  await page.click('a:text-is("Rebuild")');
  await page.click('summary:has-text("Options")');
  await page.selectOption('select:has(option[value="keep"])', 'keep');
  await page.fill('input[placeholder*="job"]', 'kept');
  await page.click('button:has-text("Start the rebuild")');
  await shown(run, page, '[aria-label=State] progress', 'the job tells how far it is');
  await run.screenshot(page, 'job');
  await run.accessible(page, 'a job under way');
  await shown(run, page, '[aria-label=State][data-status=succeeded]', 'and that it has succeeded, without a reload', { timeout: kRebuildMs });
  const { versions } = await json(server, '/v1/maps/town/versions');
  run.expect(versions.some(({ version }) => version === 'kept'), `the version is there: ${versions.map(({ version }) => version)}`);
}

async function compare(run, page, server) {
  await page.goto(`${server.origin}/#/maps/town`);
  await page.click('tr[data-version=kept] a:has-text("Compare")');
  await shown(run, page, '.difference .sides', 'what differs is counted', { timeout: kRebuildMs });
  const sides = await page.textContent('.difference .sides');
  run.expect(/Only in kept.*points on .* m²: .*standing/s.test(sides), `cars that were kept are only there: ${sides}`);
  run.expect((await page.locator('.place').count()) > 0, 'places that changed are listed');
  await page.locator('.place').first().click();

  await page.focus('.divider');
  const share = () => page.getAttribute('.divider', 'aria-valuenow').then(Number);
  const before = await share();
  for (let press = 0; press < 5; ++press) await page.keyboard.press('ArrowLeft');
  run.expect((await share()) === before - 10, `the line moves by keys: ${before}, ${await share()}`);
  await page.mouse.move(...await middleOf(page, '.divider-grip'));
  await page.mouse.down();
  const [x, y] = await middleOf(page, '.scene');
  await page.mouse.move(x, y, { steps: 3 });
  await page.mouse.up();
  run.expect(Math.abs((await share()) - 50) <= 1, `and by dragging: ${await share()}`);

  await page.check('input[value=side]');
  await page.check('label:has-text("From above") input');
  await page.waitForFunction(() => /above=1/.test(location.hash) && /layout=side/.test(location.hash) && /camera=/.test(location.hash));
  const other = await run.open(server, new URL(page.url()).hash);
  await shown(run, other, 'input[value=side]:checked', 'a shared address shows the same');
  run.expect(await other.isChecked('label:has-text("From above") input'), 'from above too');
  await run.accessible(other, 'the comparison');
  await other.click('button[aria-label^="Swap"]');
  await other.waitForFunction(() => location.hash.startsWith('#/compare/town/kept/v1'));
  run.expect(true, 'the sides swap');
  await other.context().close();
}

async function middleOf(page, selector) {
  const { x, y, width, height } = await page.locator(selector).boundingBox();
  return [x + width / 2, y + height / 2];
}

async function publish(run, page, server) {
  const active = async () => (await json(server, '/v1/maps/town')).version;
  await page.goto(`${server.origin}/#/maps/town`);
  await page.click('button[aria-label="Publish kept"]');
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'tr[data-version=kept] .badge:text-is("Active")', 'a published version is marked as active');
  run.expect((await active()) === 'kept', 'and served');
  await page.click('button:has-text("Roll back to v1")');
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'tr[data-version=v1] .badge:text-is("Active")', 'rolled back, the one before is');
  run.expect((await active()) === 'v1', 'and served');
}

async function story(run) {
  const server = await run.server();
  const page = await run.open(server);
  await upload(run, page);
  await rebuild(run, page, server);
  await compare(run, page, server);
  await publish(run, page, server);
  await localize(run, page, server);
  await server.stop();
}

async function localize(run, page, server) {
  await page.goto(`${server.origin}/#/localize/town`);
  await page.waitForSelector('canvas.scene');
  await drop(page, '.scene', [scanOf(run, 11)]);
  await shown(run, page, '.answer[data-status=ok]', 'a dropped scan is found');
  run.expect(/3σ/.test(await page.textContent('.error-plot')), 'with its ellipse');
  run.expect(/Protected: .*along/.test(await page.textContent('.error-plot')), 'its protection level');
  run.expect(/ms at the server/.test(await page.textContent('.timings')), 'its timings');
  const anywhere = await page.textContent('.answer .facts');
  await run.accessible(page, 'a scan that was found');

  await page.click('.where summary');
  await page.check('input[value=prior]');
  await page.mouse.move(...await middleOf(page, '.scene'));
  await page.mouse.down();
  const [x, y] = await middleOf(page, '.scene');
  await page.mouse.move(x + 60, y, { steps: 4 });
  await page.mouse.up();
  await shown(run, page, '.answer .facts:has-text("From the prior")', 'from a place shown by dragging it is found too');
  run.expect((await page.textContent('.answer .facts')) !== anywhere, 'and the answer tells how far off that place was');

  await drop(page, '.scene', [0, 1, 2, 3, 4].map((number) => scanOf(run, 2 * number)));
  await shown(run, page, '.drive-state:has-text("5 of 5")', 'several scans go through a session, one after the other', { timeout: 120_000 });
  await until('the session is given back', async () => (await json(server, '/v1/sessions')).sessions.length === 0, 20);
  run.expect(true, 'which is given back at the end');
}

async function vehicles(run) {
  const server = await run.server();
  const page = await run.open(server, '#/localize/town?show=vehicles');
  await shown(run, page, 'text=No vehicle is being followed', 'that no vehicle is there is said');
  const headers = { 'Content-Type': 'application/json' };
  const { id } = await json(server, '/v1/sessions', { method: 'POST', headers, body: JSON.stringify({ map: 'town', label: 'truck-7' }) });
  for (const [number, stamp] of [[11, 1], [13, 2]]) {
    await json(server, `/v1/sessions/${id}/scans?stamp_ns=${stamp}00000000`, {
      method: 'POST', headers: { 'Content-Type': 'application/octet-stream' }, body: readFileSync(scanOf(run, number)),
    });
  }
  await shown(run, page, '.vehicle:has-text("truck-7")', 'a vehicle appears by itself');
  await page.click('.vehicle');
  await run.accessible(page, 'the vehicles');
  await run.screenshot(page, 'vehicles');
  await shown(run, page, '.vehicle.stale', 'and is greyed when it sends nothing any more');
  run.expect(!(await page.content()).includes(id), 'the name of its session, which is its secret, stands nowhere');
  await fetch(`${server.origin}/v1/sessions/${id}`, { method: 'DELETE' });
  await shown(run, page, 'text=No vehicle is being followed', 'and goes when its session ends');
  await server.stop();
}

async function keys(run) {
  const server = await run.server();
  const [reader, driver] = [['read'], ['read', 'localize']].map((scopes) => run.stillmap(
    'keys', 'create', scopes.at(-1), '--store', server.store, ...scopes.flatMap((scope) => ['--scope', scope])));
  const page = await run.open(server, '#/localize/town');
  await page.fill('dialog input', 'stillmap_wrong');
  await page.keyboard.press('Enter');
  await shown(run, page, 'dialog:has-text("does not accept this key")', 'a wrong key is refused');
  await page.fill('dialog input', reader);
  await page.keyboard.press('Enter');
  await page.waitForSelector('canvas.scene');
  await drop(page, '.scene', [scanOf(run, 11)]);
  await shown(run, page, '.beside .trouble:has-text("scope")', 'a key that may not localize is told which scope it lacks');
  run.expect((await page.textContent('.scan-facts')).includes('000011.bin'), 'the scan stays');
  await page.click('.top button:has-text("Key in use")');
  await page.fill('dialog input', driver);
  await page.keyboard.press('Enter');
  await page.click('button:has-text("Find it")');
  await shown(run, page, '.answer[data-status=ok]', 'with another key it goes on');
  await server.stop();
}

async function troubles(run) {
  const server = await run.server({ options: ['--sessions-max', '1'] });
  const page = await run.open(server, '#/localize/town');
  await page.waitForSelector('canvas.scene');
  await drop(page, '.scene', [scanOf(run, 11)]);
  await page.waitForSelector('.answer[data-status=ok]');

  server.process.kill('SIGSTOP');
  await page.click('button:has-text("Find it again")');
  await shown(run, page, '.connection.slow', 'a slow server is said');
  server.process.kill('SIGCONT');
  await page.waitForSelector('.connection.slow', { state: 'detached' });
  await page.waitForSelector('button:has-text("Find it again"):enabled');

  const headers = { 'Content-Type': 'application/json' };
  const { id } = await json(server, '/v1/sessions', { method: 'POST', headers, body: '{"map": "town"}' });
  await drop(page, '.scene', [scanOf(run, 10), scanOf(run, 11)]);
  await shown(run, page, '.beside .trouble:has-text("1 sessions are open")', 'a server that is full (503) is said in its words');
  await fetch(`${server.origin}/v1/sessions/${id}`, { method: 'DELETE' });
  await page.click('.beside .trouble button:has-text("Try again")');
  await shown(run, page, '.drive-state:has-text("2 of 2")', 'and the same drive goes on once there is room', { timeout: 60_000 });

  await drop(page, '.scene', [scanOf(run, 12)]);
  await page.waitForSelector('.scan-facts:has-text("000012")');
  await page.waitForSelector('.answer[data-status=ok]');
  await server.stop();
  await page.click('button:has-text("Find it again")');
  await shown(run, page, '.beside .trouble:has-text("does not answer")', 'a server that is down is said');
  run.expect((await page.textContent('.scan-facts')).includes('000012.bin'), 'the scan stays');
  await server.start();
  await page.click('.beside .trouble button:has-text("Try again")');
  await shown(run, page, '.answer[data-status=ok]', 'and is found once it is back');

  await fetch(`${server.origin}/v1/maps/town?active=true`, { method: 'DELETE' });
  await page.click('button:has-text("Find it again")');
  await shown(run, page, '.beside .trouble:has-text("deleted")', 'a map that was deleted meanwhile is said');
  run.expect((await page.locator('canvas.scene').count()) === 1, 'what was shown stays');
  await page.goto(`${server.origin}/#/compare/town/v1/v2`);
  await shown(run, page, '.trouble:has-text("deleted")', 'in a comparison too');
  await server.stop();
}

async function tooLarge(run) {
  const server = await run.server({ options: ['--max-payload-bytes', '100000', '--max-json-bytes', '100000'] });
  const page = await run.open(server, '#/localize/town');
  await page.waitForSelector('canvas.scene');
  await drop(page, '.scene', [scanOf(run, 11)]);
  await shown(run, page, '.beside .trouble:has-text("100000")', 'a scan that is too large (413) is refused with the limit');
  await drop(page, '.scene', [join(run.sample, 'drive', 'times.txt')]);
  await shown(run, page, '.beside .trouble:has-text("times.txt")', 'a file that is no scan is refused by name');
  await page.goto(`${server.origin}/#/compare/town/v1/never`);
  await shown(run, page, 'text=never of town is not there', 'a version that is not there is said in a comparison');
  await server.stop();
}

async function everyView(run) {
  const server = await run.server();
  for (const colorScheme of ['dark', 'light']) {
    const page = await run.open(server, '', { colorScheme });
    for (const [view, sign] of [
      ['maps', 'text="town"'], ['maps/town', 'h2:text-is("Versions")'], ['jobs', 'h1:text-is("Jobs")'], ['view/town/v1', 'canvas'],
      ['compare/town/v1/v1', '.difference'], ['localize/town', '.where'], ['keys', 'h1, h2'], ['api', 'h1, h2'],
    ]) {
      await page.goto(`${server.origin}/#/${view}`);
      await page.waitForSelector(sign);
      await run.accessible(page, `${view}, ${colorScheme}`);
    }
    await page.context().close();
  }
  await server.stop();
}

async function size(run) {
  const folder = join(dirname(run.program), 'web', 'assets');
  const scripts = readdirSync(folder).filter((name) => name.endsWith('.js'));
  const bytes = scripts.reduce((sum, name) => sum + gzipSync(readFileSync(join(folder, name)), { level: 9 }).length, 0);
  run.expect(scripts.length > 0 && bytes < kMostScriptBytes, `all script together, gzipped: ${bytes} bytes in ${scripts.length} pieces`);
}

await main({ story, vehicles, keys, troubles, tooLarge, everyView, size });

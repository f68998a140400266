// The page from end to end, as a map team uses it: a drive is uploaded, a version rebuilt of it and watched, compared
// with the one before, activated and rolled back, and a scan found in it. Then every view for its accessibility.

import { readdirSync, readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { gzipSync } from 'node:zlib';
import { main } from './harness.mjs';
import { drop, json, middleOf, scanOf, shown, until } from './support.mjs';

const kMostScriptBytes = 400_000;
const kMostApiScriptBytes = 500_000;
/** A rebuild of the sample drive on a machine that does other things too. */
const kRebuildMs = 240_000;

async function upload(run, page) {
  await page.click('.top a:text-is("Maps")');
  await page.click('a:text-is("town")');
  await page.click('button:has-text("Upload")');
  await page.setInputFiles('dialog input[type=file] >> nth=0', run.tar('drive', 'monday.tar'));
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'tr[data-drive] .badge:text-is("Complete")', 'an uploaded drive is listed as complete', { timeout: kRebuildMs });
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
  run.expect(/Only in kept.*points on .* m²: .*measured/s.test(sides), `cars that were kept are only there: ${sides}`);
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

async function activate(run, page, server) {
  const active = async () => (await json(server, '/v1/maps/town')).version;
  await page.goto(`${server.origin}/#/maps/town`);
  await page.click('button[aria-label="Activate kept"]');
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'tr[data-version=kept] .badge:text-is("Active")', 'an activated version is marked as active');
  run.expect((await active()) === 'kept', 'and served');
  await page.click('button:has-text("Roll back to v1")');
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'tr[data-version=v1] .badge:text-is("Active")', 'rolled back, the one before is');
  run.expect((await active()) === 'v1', 'and served');
}

async function story(run) {
  // Nothing is refused on this way; a tileset that is still being made is waited for.
  run.expectedErrors = [/status of 503 .*tileset\.json$/];
  const server = await run.shared();
  const page = await run.open(server);
  await upload(run, page);
  await rebuild(run, page, server);
  await compare(run, page, server);
  await activate(run, page, server);
  await localize(run, page, server);
}

async function localize(run, page, server) {
  await page.goto(`${server.origin}/#/localize/town`);
  await page.waitForSelector('canvas.scene');
  await drop(page, '.scene', [scanOf(run, 11)]);
  await shown(run, page, '.answer[data-status=ok]', 'a dropped scan is found');
  run.expect(/3σ/.test(await page.textContent('.error-plot')), 'with its ellipse');
  run.expect(/Protection level: .*along/.test(await page.textContent('.error-plot')), 'its protection level');
  run.expect(/ms on the server/.test(await page.textContent('.timings')), 'its timings');
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

async function everyView(run) {
  const server = await run.shared();
  for (const colorScheme of ['dark', 'light']) {
    const page = await run.open(server, '', { colorScheme });
    for (const [view, sign] of [
      ['maps', 'text="town"'], ['maps/town', 'h2:text-is("Versions")'], ['jobs', 'h1:text-is("Jobs")'], ['view/town/v1', 'canvas'],
      ['compare/town/v1/v1', '.difference'], ['localize/town', '.where'], ['keys', 'h1, h2'], ['api', '.opblock'],
    ]) {
      await page.goto(`${server.origin}/#/${view}`);
      await page.waitForSelector(sign);
      await run.accessible(page, `${view}, ${colorScheme}`);
    }
    await page.context().close();
  }
}

async function size(run) {
  const folder = join(dirname(run.program), 'web', 'assets');
  const scripts = readdirSync(folder).filter((name) => name.endsWith('.js'));
  const sum = (names) => names.reduce((all, name) => all + gzipSync(readFileSync(join(folder, name)), { level: 9 }).length, 0);
  // Swagger UI is loaded by the API view alone.
  const [swagger, own] = [sum(scripts.filter((name) => name.startsWith('apipage'))), sum(scripts.filter((name) => !name.startsWith('apipage')))];
  run.expect(own > 0 && own < kMostScriptBytes, `script of all other views, gzipped: ${own} bytes`);
  run.expect(swagger > 0 && swagger < kMostApiScriptBytes, `script of the API view, gzipped: ${swagger} bytes`);
}

await main({ story, everyView, size });

// Localization in the page: live vehicles, keys, and what goes wrong: a server that is slow, full, down, of small limits,
// and a map that is deleted while it is shown.

import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { main } from './harness.mjs';
import { drop, json, scanOf, shown } from './support.mjs';

async function vehicles(run) {
  const server = await run.server();
  const page = await run.open(server, '#/localize/town?show=vehicles');
  await shown(run, page, 'text=No vehicle is tracked', 'that no vehicle is there is said');
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
  await shown(run, page, 'text=No vehicle is tracked', 'and goes when its session ends');
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
  await page.click('.top button:has-text("Key set")');
  await page.fill('dialog input', driver);
  await page.keyboard.press('Enter');
  await page.click('button:has-text("Find the scan")');
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
  await shown(run, page, '.page .empty:has-text("town has no version “never”")', 'a version that is not there is said in a comparison');
  await server.stop();
}

await main({ vehicles, keys, troubles, tooLarge });

// Makes the pictures of the page: node pictures.mjs STILLMAP SAMPLE --screenshots web/pictures   (./dev pictures)
// SAMPLE is what tests/integration/sample_map.sh makes. Another version of its map, with the cars left in, is built here.

import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { main } from './harness.mjs';
import { drop, json, scanOf } from './support.mjs';

// Points are noise to JPEG: below 150 kB each.
const kJpegQuality = 50;
const kSize = { width: 1280, height: 760 };

/** Until the picture in 3D has not changed for a second, and no tile is on the way. */
async function still(page) {
  let before = '';
  for (let tries = 0; tries < 60; ++tries) {
    await page.waitForTimeout(1000);
    const now = (await page.locator('canvas').first().screenshot()).toString('base64');
    if (now === before && (await page.getByText('loading').count()) === 0) return;
    before = now;
  }
}

async function take(run, page, name) {
  const path = join(run.screenshots, `${name}.jpg`);
  await page.screenshot({ path, type: 'jpeg', quality: kJpegQuality });
  console.log(path);
}

async function pictures(run) {
  if (run.screenshots === undefined) throw new Error('usage: pictures.mjs STILLMAP SAMPLE --screenshots FOLDER');
  const server = await run.server();
  const kept = join(run.scratch, 'kept');
  run.stillmap('build', join(run.sample, 'drive'), '-o', kept, '--select', '::2', '--movable', 'keep', '--register-to', join(run.sample, 'map'));
  run.stillmap('store', 'add', server.store, 'town', 'cars-kept', kept);

  const page = await run.open(server, '', { viewport: kSize });
  const go = async (place, sign) => {
    await page.goto(`${server.origin}/#/${place}`);
    await page.waitForSelector(sign);
  };
  await go('maps/town', 'tr[data-version=cars-kept]');
  await page.waitForTimeout(1500);
  await take(run, page, 'versions');

  await go('view/town/v1', 'canvas');
  await still(page);
  await take(run, page, 'view');

  await go('compare/town/cars-kept/v1', '.places');
  await page.locator('.place').first().click();
  await still(page);
  await take(run, page, 'compare');

  await go('localize/town', 'canvas.scene');
  await drop(page, '.scene', [scanOf(run, 11)]);
  await page.waitForSelector('.answer[data-status=ok]');
  await page.waitForSelector('.stage-legend:not(:has-text("computing"))');
  await still(page);
  await take(run, page, 'localize');

  const fleet = await Promise.all([[3, 'truck-7'], [37, 'van-2']].map(([number, label]) => vehicle(run, server, number, label)));
  for (const send of [...fleet, ...fleet]) await send();
  await go('localize/town?show=vehicles', '.vehicle:has-text("van-2")');
  // Without the scan of the picture before.
  await page.reload();
  await page.click('.vehicle:has-text("van-2")');
  await still(page);
  // Both are fresh in the picture.
  await Promise.all(fleet.map((send) => send()));
  await page.waitForFunction(() => document.querySelectorAll('.vehicle.ok').length === 2);
  await take(run, page, 'vehicles');
  await server.stop();
}

/** A session. @return sends its next scan, 0.1 s after the one before; the place stays. */
async function vehicle(run, server, number, label) {
  const headers = { 'Content-Type': 'application/json' };
  const { id } = await json(server, '/v1/sessions', { method: 'POST', headers, body: JSON.stringify({ map: 'town', label }) });
  let sent = 0;
  return () => json(server, `/v1/sessions/${id}/scans?stamp_ns=${++sent}00000000`, {
    method: 'POST', headers: { 'Content-Type': 'application/octet-stream' }, body: readFileSync(scanOf(run, number)),
  });
}

await main({ pictures });

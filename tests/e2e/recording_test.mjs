// A recording of two lidars becomes a served map by clicks: the page asks which of them, before the upload where the file
// has an index (MCAP), after it where the server has to read the file (rosbag2's SQLite).

import { spawnSync } from 'node:child_process';
import { createRequire } from 'node:module';
import { writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { main } from './harness.mjs';
import { json, shown } from './support.mjs';

const { McapWriter } = createRequire(new URL('../../web/package.json', import.meta.url))('@mcap/core');
const kSmallBag = fileURLToPath(new URL('../integration/small_bag.py', import.meta.url));
const kRebuildMs = 240_000;

function smallBag(...words) {
  const { status, stdout, stderr } = spawnSync('python3', [kSmallBag, ...words], { maxBuffer: 1 << 30 });
  if (status !== 0) throw new Error(`small_bag.py: ${stderr}`);
  return stdout;
}

/** The sample drive as MCAP, as other programs write it. @return the file */
async function writeMcap(run) {
  const pieces = [];
  let size = 0n;
  const writer = new McapWriter({
    writable: {
      write: async (bytes) => {
        pieces.push(Buffer.from(bytes));
        size += BigInt(bytes.length);
      },
      position: () => size,
    },
  });
  await writer.start({ profile: 'ros2', library: 'e2e' });
  const channels = new Map();
  const stream = smallBag('messages', join(run.sample, 'drive'));
  for (let at = 0; at < stream.length;) {
    const end = stream.indexOf(10, at);
    const { topic, type, log_ns, bytes } = JSON.parse(stream.subarray(at, end).toString());
    if (!channels.has(topic)) {
      const schemaId = await writer.registerSchema({ name: type, encoding: 'ros2msg', data: new Uint8Array() });
      channels.set(topic, await writer.registerChannel({ schemaId, topic, messageEncoding: 'cdr', metadata: new Map() }));
    }
    const [channelId, time, data] = [channels.get(topic), BigInt(log_ns), stream.subarray(end + 1, end + 1 + bytes)];
    await writer.addMessage({ channelId, sequence: 0, logTime: time, publishTime: time, data });
    at = end + 1 + bytes;
  }
  await writer.end();
  const file = join(run.scratch, 'yard.mcap');
  writeFileSync(file, Buffer.concat(pieces));
  return file;
}

async function asksBeforeTheUpload(run) {
  const server = await run.server({ empty: true });
  const page = await run.open(server);
  await page.getByRole('button', { name: 'Upload' }).click();
  await page.locator('dialog input[type=file]').first().setInputFiles(await writeMcap(run));
  await page.waitForSelector('dialog .topics');
  run.expect((await json(server, '/v1/maps')).maps.length === 0, 'the topics are shown before anything is sent');
  const scans = page.getByLabel('Scans');
  const choices = await scans.locator('option').allInnerTexts();
  run.expect(choices.join() === 'Choose a topic,/points (40 messages),/rear (40 messages)', `with their messages: ${choices}`);
  run.expect(await page.isDisabled('dialog button[type=submit]'), 'without a choice it is not sent');
  await run.accessible(page, 'the topics of a recording');
  await scans.selectOption('/points');
  run.expect(await page.getByLabel('/rear').isVisible(), 'other lidars can join it');
  await run.accessible(page, 'several lidars of a recording');
  await run.screenshot(page, 'recording');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.upload.done');
  await page.click('a:text-is("yard")');
  await shown(run, page, 'tr[data-drive] .badge:text-is("Complete")', 'the recording is complete without another question');
  const [{ inspection }] = (await json(server, '/v1/maps/yard/drives')).drives;
  run.expect(inspection.topic === '/points' && inspection.scans === 40, `its scans are those of the choice: ${JSON.stringify(inspection)}`);
  run.expect(/40 scans.* of \/points/.test(await page.innerText('tr[data-drive] .inspected')), 'what it holds stands beside it');
  await becomesAServedMap(run, page, server);
  await server.stop();
}

async function becomesAServedMap(run, page, server) {
  await page.click('a:text-is("Rebuild")');
  await page.fill('input[placeholder*="job"]', 'v1');
  await page.click('button:has-text("Start the rebuild")');
  await shown(run, page, '[aria-label=State][data-status=succeeded]', 'a map is built of it', { timeout: kRebuildMs });
  await page.click('text=Versions of yard');
  await page.click('button[aria-label="Activate v1"]');
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'tr[data-version=v1] .badge:text-is("Active")', 'and activated');
  const { version, state, points } = await json(server, '/v1/maps/yard');
  run.expect(version === 'v1' && state === 'ready' && points > 10_000, `the map is served: ${version} ${state} ${points}`);
}

async function asksAfterTheUpload(run) {
  smallBag('bag', join(run.sample, 'drive'), join(run.scratch, 'bag'));
  const server = await run.server();
  const page = await run.open(server, '#/maps/town');
  await page.locator('.heading').first().getByRole('button', { name: 'Upload' }).click();
  await page.locator('dialog input[type=file]').first().setInputFiles(join(run.scratch, 'bag', 'bag.db3'));
  await page.click('dialog button[type=submit]');
  await shown(run, page, '.upload.done a:has-text("choose the topics")', 'a recording that needs a choice is kept, and the page says so');
  await page.waitForSelector('tr[data-drive] .badge:text-is("Needs a choice")');
  await page.click('tr[data-drive] button:text-is("Choose topics")');
  run.expect(/clouds on \/points/.test(await page.innerText('dialog .remark')), 'which choice is said');
  run.expect(await page.isDisabled('dialog button[type=submit]'), 'one has to be made');
  await page.getByLabel('Scans').selectOption('/rear');
  await page.fill('dialog input[placeholder="as in the messages"]', 'rear_lidar');
  await run.accessible(page, 'the choice of topics');
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'dialog .remark:has-text("rear_lidar")', 'a choice that does not fit is asked for again');
  await page.fill('dialog input[placeholder="as in the messages"]', '');
  await page.getByLabel('Other words').fill('stamps=recorded');
  await run.screenshot(page, 'choice');
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'tr[data-drive] .badge:text-is("Complete")', 'a choice that fits completes the drive');
  run.expect(await page.locator('.upload').count() === 0, 'and its upload asks for none any more');
  const { inspection } = (await json(server, '/v1/maps/town/drives')).drives.at(-1);
  run.expect(inspection.notes.some((note) => note.includes('when the recorder got')), `other words count: ${JSON.stringify(inspection.notes)}`);
  await shown(run, page, '.inspected .finding', 'what looks wrong with it stands beside it');
  await run.accessible(page, 'findings beside a drive');
  await run.screenshot(page, 'findings');
  await page.click('a:text-is("Rebuild")');
  await shown(run, page, 'form.rebuild label:has-text("bag")', 'and a map can be built of it');
  await server.stop();
}

await main({ asksBeforeTheUpload, asksAfterTheUpload });

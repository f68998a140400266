// Rebuilds: the form, live progress, log, verdict, cancel, and the report when one is done.

import { readFileSync } from 'node:fs';
import { main } from './harness.mjs';

/** Uploads the sample's drive by the API. @param meanwhile done before it is complete @return its number */
async function drive(run, server, name, meanwhile = () => undefined) {
  const at = `${server.origin}/v1/maps/town/drives`;
  const headers = { 'Content-Type': 'application/json' };
  const { id } = await (await fetch(at, { method: 'POST', headers, body: JSON.stringify({ name }) })).json();
  await fetch(`${at}/${id}/parts/1`, { method: 'PUT', body: readFileSync(run.tar('drive')) });
  await meanwhile();
  const done = await (await fetch(`${at}/${id}/complete`, { method: 'POST' })).json();
  if (done.status !== 'complete') throw new Error(`the drive is ${done.status}: ${done.error}`);
  return id;
}

async function rebuild(run) {
  const server = await run.server();
  const page = await run.open(server, '#/maps/town/rebuild');
  await page.waitForSelector('text=This map has no drives yet');
  run.expect(true, 'without a drive the form says what is missing');
  await drive(run, server, 'monday', async () => {
    await page.waitForSelector('text=“monday” is not complete yet');
    run.expect(/MB have arrived/.test(await page.textContent('.empty')), 'of one under way, how far it is');
  });
  await page.waitForSelector('form.rebuild label:has-text("monday")');
  await page.click('summary:has-text("Options")');
  await page.selectOption('.field:has(label:text-is("Cleaning")) select', 'none');
  await page.fill('.field:has(label:text-is("Name of the version")) input', 'Not a name');
  run.expect(await page.isDisabled('form.rebuild button[type=submit]'), 'a name that cannot be is not sent');
  await page.fill('.field:has(label:text-is("Name of the version")) input', 'v2');
  await run.accessible(page, 'the form');
  await page.reload();
  await page.waitForSelector('form.rebuild');
  run.expect(await page.inputValue('.field:has(label:text-is("Name of the version")) input') === 'v2'
    && await page.inputValue('.field:has(label:text-is("Cleaning")) select') === 'none', 'what was chosen outlives a reload');
  await run.screenshot(page, 'rebuild');
  await page.click('form.rebuild button[type=submit]');
  await page.waitForSelector('.job-state[data-status=processing]');
  run.expect(page.url().includes('#/jobs/1'), 'the job is shown');
  await watch(run, page);
  await verdict(run, server, page);
  await server.stop();
}

/** Progress comes by itself, also after a reload, and the end is told elsewhere on the page. */
async function watch(run, page) {
  const share = () => page.locator('.job-state progress').evaluate((bar) => bar.value);
  await page.waitForFunction(() => document.querySelector('.job-state progress')?.value > 0.02);
  const before = await share();
  await page.waitForFunction((least) => (document.querySelector('.job-state progress')?.value ?? 1) > least, before);
  run.expect(true, 'the bar moves');
  run.expect(/%/.test(await page.locator('.job-line').innerText()), 'stage and share are told');
  await run.accessible(page, 'a running job');
  await run.screenshot(page, 'job');
  await page.reload();
  await page.waitForSelector('.job-state');
  run.expect(await page.locator('.report input').isChecked().catch(() => true), 'what was asked to be reported outlives a reload');
  await page.click('nav a:text-is("API")');
  await page.waitForSelector('.notice:has-text("Rebuild of town: v2 is stored")', { timeout: 240_000 });
  run.expect(true, 'its end is told wherever the person is');
  await page.click('.notice a');
}

async function verdict(run, server, page) {
  await page.waitForSelector('.gate[data-verdict=fail]');
  const words = await page.locator('.gate').innerText();
  run.expect(/checks failed/.test(words) && /at least 20/.test(words), 'the verdict is told in words');
  run.expect(/v2 is stored/.test(await page.locator('.outcome').innerText()), 'and what came of it');
  await page.waitForSelector('.log:has-text("gate")');
  run.expect(true, 'the log is there');
  await run.accessible(page, 'a job that is done');
  await run.screenshot(page, 'job_done');
  await page.click('text=Versions of town');
  await page.waitForSelector('tr[data-version=v2]');
  run.expect(true, 'the version is in the list');
  await page.waitForSelector('tr[data-version=v2] a.badge:text-is("Checks failed")');
  run.expect(true, 'with a mark that it did not pass the checks');
}

async function cancel(run) {
  const server = await run.server();
  await drive(run, server, 'monday');
  const post = () => fetch(`${server.origin}/v1/maps/town/rebuild`, {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ drives: [1] }),
  });
  await post();
  await post();
  const page = await run.open(server, '#/jobs');
  await page.waitForSelector('tr[data-job="1"][data-status=processing]');
  await page.waitForSelector('tr[data-job="2"][data-status=enqueued]');
  await run.accessible(page, 'the list of jobs');
  await run.screenshot(page, 'jobs');
  await page.selectOption('label:has-text("State") select', 'enqueued');
  await page.waitForSelector('tr[data-job="1"]', { state: 'detached' });
  run.expect(page.url().includes('status=enqueued'), 'filters stand in the address');
  await page.click('tr[data-job="2"] a');
  await page.click('text=Cancel the job');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.job-state[data-status=canceled]');
  run.expect(true, 'a job that waits is cancelled');
  await page.goto(`${server.origin}/#/jobs/1`);
  await page.click('text=Cancel the job');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('.job-state[data-status=canceled]');
  run.expect(/Nothing was stored/.test(await page.locator('.outcome').innerText()), 'and one that runs, told in words');
  await page.goto(`${server.origin}/#/jobs/77`);
  await page.waitForSelector('.trouble:has-text("kept for some days")');
  run.expect(true, 'a job that is not there is said');
  await server.stop();
}

await main({ rebuild, cancel });

// The list of maps and one map: made, kept fresh, activated, rolled back, deleted, gone while it is shown.

import { readFileSync } from 'node:fs';
import { main } from './harness.mjs';
import { scanOf } from './support.mjs';

const json = async (server, method, path, headers = {}) => {
  const response = await fetch(`${server.origin}${path}`, { method, headers });
  return { status: response.status, body: response.status === 204 ? undefined : await response.json() };
};

async function list(run) {
  const server = await run.server();
  const page = await run.open(server);
  const row = page.locator('tr[data-map=town]');
  await row.waitFor();
  await row.locator('.picture.there').waitFor();
  run.expect(true, 'the picture from above is shown');
  const text = await row.innerText();
  run.expect(/Ready/.test(text) && /v1/.test(text) && /ago|just now/.test(text), `state, version and age: ${text.replace(/\s+/g, ' ')}`);
  await run.accessible(page, 'the list');
  await run.screenshot(page, 'maps');

  await page.click('text=New map');
  await page.fill('dialog input', 'Harbour');
  await page.click('dialog button[type=submit]');
  run.expect(/lower-case letters/.test(await page.locator('dialog .fault').innerText()), 'a name that cannot be is refused in words');
  await page.reload();
  await page.click('text=New map');
  run.expect(await page.inputValue('dialog input') === 'Harbour', 'what was typed outlives a reload');
  await page.fill('dialog input', 'harbour');
  await page.keyboard.press('Enter');
  await page.waitForSelector('h1:text-is("harbour")');
  run.expect(page.url().endsWith('#/maps/harbour'), 'a new map is made and shown');

  await page.click('nav a:text-is("Maps")');
  await page.waitForSelector('tr[data-map=harbour]');
  await json(server, 'PUT', '/v1/maps/quarry');
  await page.waitForSelector('tr[data-map=quarry]');
  run.expect(true, 'a map that somebody else made comes by itself');
  await page.click('tr[data-map=quarry] th a');
  await page.waitForSelector('h1:text-is("quarry")');
  await json(server, 'DELETE', '/v1/maps/quarry');
  await page.waitForSelector('text=There is no map “quarry”');
  run.expect(true, 'a map that is deleted while it is shown is said in words');
  await server.stop();
}

async function activate(run) {
  const server = await run.server();
  run.stillmap('build', `${run.sample}/drive`, '-o', `${run.scratch}/other`, '--select', '1::2');
  run.stillmap('store', 'add', server.store, 'town', 'v2', `${run.scratch}/other`);
  const page = await run.open(server, '#/maps/town');
  const v2 = page.locator('tr[data-version=v2]');
  await v2.waitFor();
  await run.accessible(page, 'one map');
  await run.screenshot(page, 'map');
  await v2.getByRole('button', { name: 'Activate v2' }).click();
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('dialog :text("in the map frame of")');
  run.expect(true, 'another frame is explained, and asked for in words');
  await run.screenshot(page, 'other_frame');
  await page.check('dialog input[type=checkbox]');
  await page.click('dialog button[type=submit]');
  await v2.locator('text=Active').waitFor();
  run.expect((await json(server, 'GET', '/v1/maps/town')).body.version === 'v2', 'it is active on the server');

  await page.click('text=Roll back to v1');
  await page.click('dialog button[type=submit]');
  await page.check('dialog input[type=checkbox]');
  await page.click('dialog button[type=submit]');
  await page.locator('tr[data-version=v1] >> text=Active').waitFor();
  run.expect((await json(server, 'GET', '/v1/maps/town')).body.version === 'v1', 'rolled back');

  // Somebody else changes the map while the dialog is open, and the page has not seen it yet.
  await page.route('**/v1/maps/town/versions', (route) => route.abort());
  await v2.getByRole('button', { name: 'Activate v2' }).click();
  await json(server, 'POST', '/v1/maps/town/versions/v2/activate?new_frame=true');
  await json(server, 'POST', '/v1/maps/town/versions/v1/activate?new_frame=true');
  await page.click('dialog button[type=submit]');
  await page.check('dialog input[type=checkbox]');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('dialog .trouble:has-text("Somebody else, or a job, changed the map")');
  run.expect(true, 'a change by somebody else in the meantime is said, and nothing is done');
  await page.keyboard.press('Escape');
  await page.unroute('**/v1/maps/town/versions');
  await remove(run, server, page);
  await server.stop();
}

async function remove(run, server, page) {
  await page.locator('tr[data-version=v2]').getByRole('button', { name: 'Delete v2' }).click();
  await page.fill('dialog input', 'v2');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('tr[data-version=v2]', { state: 'detached' });
  run.expect(true, 'a version is deleted');
  await page.locator('.heading').first().getByRole('button', { name: 'Delete' }).click();
  run.expect(await page.isDisabled('dialog button[type=submit]'), 'a map is not deleted before its name is typed');
  await page.fill('dialog input', 'town');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('text=No maps yet');
  run.expect((await json(server, 'GET', '/v1/maps/town')).status === 404, 'then it is deleted, with its active version');
  await run.accessible(page, 'the empty list');
}

async function trouble(run) {
  // More than any disk has, so that it is below its reserve.
  const server = await run.server({ options: ['--quotas-disk-reserve-bytes', '1000000000000000'] });
  const page = await run.open(server);
  await page.waitForSelector('.server-trouble:has-text("less than its reserve")');
  run.expect(true, 'what is wrong with the server is said above the list');
  await run.accessible(page, 'the list of a server in trouble');
  await run.screenshot(page, 'server_trouble');
  await server.stop();
}

/** A version for some vehicles: begun, with the answers of both groups, made larger, completed. */
async function rollout(run) {
  const server = await run.server();
  run.stillmap('store', 'add', server.store, 'town', 'v2', `${run.sample}/map`);
  const page = await run.open(server, '#/maps/town');
  await page.getByRole('button', { name: 'Roll out v2' }).click();
  await page.fill('dialog input', '0');
  await page.fill('dialog textarea', 'depot-*');
  await run.accessible(page, 'the roll-out dialog');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('h2:text-is("Roll-out of v2")');
  run.expect(true, 'the roll-out is shown');
  while ((await json(server, 'GET', '/v1/maps/town/rollout')).body.version_state !== 'ready') await page.waitForTimeout(50);
  const body = readFileSync(scanOf(run, 1));
  for (const vehicle of ['depot-1', 'truck-7']) {
    await fetch(`${server.origin}/v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1&vehicle=${vehicle}`, {
      method: 'POST', body, headers: { 'Content-Type': 'application/octet-stream' },
    });
  }
  const row = async (name) => {
    const there = page.locator(`tr[data-vehicle=${name}]:has-text("v")`);
    await there.waitFor();
    return (await there.innerText()).replace(/\s+/g, ' ');
  };
  run.expect(/depot-1 v2 .* 1 0 0/.test(await row('depot-1')), `its vehicle has the new version: ${await row('depot-1')}`);
  run.expect(/truck-7 v1 .* 1 0 0/.test(await row('truck-7')), `the others have the active one: ${await row('truck-7')}`);
  await page.locator('table.rollout tr:has-text("v2") td:text-is("1")').first().waitFor();
  await run.accessible(page, 'a map with a roll-out');
  await page.locator('h2:text-is("Roll-out of v2")').scrollIntoViewIfNeeded();
  await run.screenshot(page, 'rollout');
  await page.click('text=Set the share');
  await page.fill('dialog input', '25');
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('text=25 % of the vehicles, depot-*');
  run.expect((await json(server, 'GET', '/v1/maps/town/rollout')).body.answers.rollout.ok === 1, 'the counts go on');
  await page.getByRole('button', { name: 'Complete' }).click();
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('h2:text-is("Roll-out of v2")', { state: 'detached' });
  run.expect((await json(server, 'GET', '/v1/maps/town')).body.version === 'v2', 'completed, it is active');
  await page.getByRole('button', { name: 'Roll out v1' }).click();
  await page.click('dialog button[type=submit]');
  await page.locator('section:has(#rollout)').getByRole('button', { name: 'End' }).click();
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('h2:text-is("Roll-out of v1")', { state: 'detached' });
  run.expect(true, 'another one is ended');
  await server.stop();
}

await main({ list, activate, rollout, trouble });

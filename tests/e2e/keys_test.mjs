// Keys made and revoked on the page, scopes that are missing, and the API page.

import { main } from './harness.mjs';

async function keys(run) {
  const server = await run.server();
  const page = await run.open(server, '#/keys');
  await page.waitForSelector('text=The server has no keys');
  run.expect((await page.getByRole('button', { name: 'New key' }).count()) === 0, 'the first key is not made on the page');
  const first = run.stillmap('keys', 'create', 'first', '--store', server.store, ...['read', 'localize', 'write', 'admin'].flatMap((scope) => ['--scope', scope]));
  await page.reload();
  await page.fill('dialog input', first);
  await page.keyboard.press('Enter');
  await page.getByRole('button', { name: 'New key' }).click();
  await page.click('dialog button[type=submit]');
  run.expect(/A name is needed/.test(await page.locator('dialog .fault').innerText()), 'a key needs a name');
  await page.fill('dialog input:not([type=checkbox])', 'operator');
  await run.accessible(page, 'the form of a key');
  await page.click('dialog button[type=submit]');
  run.expect(/^stillmap_/.test(await page.locator('[data-secret]').innerText()), 'the key is shown');
  await run.screenshot(page, 'key_made');
  await page.click('text=I have it');
  await page.waitForSelector('tr[data-key=operator]');
  run.expect(/Key in use/.test(await page.locator('header').innerText()), 'the page goes on with the key that was given');

  await page.getByRole('button', { name: 'New key' }).click();
  await page.fill('dialog input:not([type=checkbox])', 'display');
  await page.locator('dialog').getByRole('textbox', { name: 'Maps' }).fill('to*, depot');
  await page.click('dialog button[type=submit]');
  const display = await page.locator('[data-secret]').innerText();
  await page.click('text=I have it');
  run.expect((await page.locator('tr[data-key=display]').innerText()).includes('to*, depot'), 'the list says for which maps a key is');
  await run.accessible(page, 'the list of keys');
  await scopes(run, server, display);
  await page.locator('tr[data-key=display]').getByRole('button').click();
  await page.click('dialog button[type=submit]');
  await page.waitForSelector('tr[data-key=display] >> text=Revoked');
  run.expect((await fetch(`${server.origin}/v1/maps`, { headers: { Authorization: `Bearer ${display}` } })).status === 401,
    'a key is revoked');
  await server.stop();
}

/** What a key may not do is said in words, and nothing that was typed is lost. */
async function scopes(run, server, display) {
  const page = await run.open(server, '#/maps');
  await page.fill('dialog input', display);
  await page.keyboard.press('Enter');
  await page.waitForSelector('tr[data-map=town] .picture.there');
  run.expect(true, 'pictures come with the key');
  await page.click('text=New map');
  await page.fill('dialog input', 'depot');
  await page.keyboard.press('Enter');
  await page.waitForSelector('dialog .trouble:has-text("scope")');
  run.expect(await page.inputValue('dialog input') === 'depot', '403 is said in words, and what was typed stays');
  await page.keyboard.press('Escape');
  await page.click('nav a:text-is("Keys")');
  await page.waitForSelector('text=Keys are for administrators');
  run.expect(true, 'keys are not shown without the scope admin');
  await page.context().close();
}

async function apiPage(run) {
  const server = await run.server();
  const page = await run.open(server, '#/api');
  const { paths } = await (await fetch(`${server.origin}/openapi.json`)).json();
  const routes = Object.values(paths).reduce((sum, methods) => sum + Object.keys(methods).length, 0);
  await page.waitForSelector('#route-listMaps');
  run.expect(await page.locator('[id^=route-]').count() === routes, `all ${routes} routes are there`);
  await page.click('#route-getMap summary');
  await page.waitForSelector('#route-getMap .curl');
  run.expect((await page.locator('#route-getMap .curl').innerText()).includes('/v1/maps/MAP'), 'a line for curl');
  await page.fill('#route-getMap .try input', 'town');
  await page.click('#route-getMap .try button');
  await page.waitForSelector('#route-getMap .try pre:has-text("voxel_size_m")');
  run.expect(true, 'a route is tried');
  await run.accessible(page, 'the API page');
  await page.click('#route-getMap a.type:text-is("Map")');
  await page.waitForSelector('#schema-Map[open]');
  await run.screenshot(page, 'api');
  await page.fill('input[type=search]', 'rebuild');
  run.expect(await page.locator('[id^=route-]').count() < 5, 'routes are filtered');
  await server.stop();
}

await main({ keys, apiPage });

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
  run.expect(/Enter a name/.test(await page.locator('dialog .fault').innerText()), 'a key needs a name');
  await page.fill('dialog input:not([type=checkbox])', 'operator');
  await run.accessible(page, 'the form of a key');
  await page.click('dialog button[type=submit]');
  run.expect(/^stillmap_/.test(await page.locator('[data-secret]').innerText()), 'the key is shown');
  await run.screenshot(page, 'key_made');
  await page.click('dialog button:text-is("Done")');
  await page.waitForSelector('tr[data-key=operator]');
  run.expect(/Key set/.test(await page.locator('header').innerText()), 'the page goes on with the key that was given');

  await page.getByRole('button', { name: 'New key' }).click();
  await page.fill('dialog input:not([type=checkbox])', 'display');
  await page.locator('dialog').getByRole('textbox', { name: 'Maps' }).fill('to*, depot');
  await page.click('dialog button[type=submit]');
  const display = await page.locator('[data-secret]').innerText();
  await page.click('dialog button:text-is("Done")');
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
  await page.waitForSelector('text=Only a key with the scope “admin” can manage keys');
  run.expect(true, 'keys are not shown without the scope admin');
  await page.context().close();
}

async function apiPage(run) {
  const server = await run.server();
  const page = await run.open(server, '#/maps');
  const scripts = () => page.evaluate(() => performance.getEntriesByType('resource').map(({ name }) => name).join(' '));
  await page.waitForSelector('tr[data-map=town]');
  run.expect(!(await scripts()).includes('apipage'), 'no other view loads Swagger UI');
  await page.click('nav a:text-is("API")');
  const { paths } = await (await fetch(`${server.origin}/openapi.json`)).json();
  const count = Object.values(paths).reduce((sum, methods) => sum + Object.keys(methods).length, 0);
  await page.waitForSelector('#operations-maps-getMap');
  run.expect(await page.locator('.opblock').count() === count, `all ${count} operations are there`);
  run.expect(await page.getAttribute('a:has-text("openapi.json")', 'href') === '/openapi.json', 'the contract can be downloaded');
  await page.focus('#operations-maps-getMap .opblock-summary-control');
  await page.keyboard.press('Enter');
  await page.waitForURL(/#\/api\/route\/getMap$/);
  run.expect(true, 'an operation opens by the keyboard, and the address names it');
  await page.waitForSelector('#operations-maps-getMap :text("Needs a key with the scope")');
  await page.fill('#operations-maps-getMap input', 'town');
  await page.click('#operations-maps-getMap .execute');
  await page.waitForSelector('#operations-maps-getMap .live-responses-table :text("voxel_size_m")');
  run.expect((await page.innerText('#operations-maps-getMap .curl-command')).includes('/v1/maps/town'), 'a request is sent, with its curl command');
  await run.accessible(page, 'the API page');
  await run.screenshot(page, 'api');
  await page.fill('.operation-filter-input', 'rebuild');
  await page.waitForFunction(() => document.querySelectorAll('.opblock').length < 5);
  run.expect(await page.locator('.opblock').count() > 0, 'operations are filtered by their words');
  const linked = await run.open(server, '#/api/route/deleteMap');
  await linked.waitForSelector('#operations-maps-deleteMap.is-open');
  await linked.waitForFunction(() => document.getElementById('operations-maps-deleteMap').getBoundingClientRect().top < 400);
  run.expect(await linked.locator('#operations-maps-deleteMap .execute').count() === 0, 'a link opens an operation; nothing that changes the server can be sent');
  await linked.context().close();
  await page.context().close();
  await server.stop();
}

await main({ keys, apiPage });

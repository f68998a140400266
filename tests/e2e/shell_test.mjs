// The page's frame: navigation, colours, the key that a server asks for, a server that goes away and comes back.

import { main } from './harness.mjs';

/** Whether an element comes within the patience, said as an expectation. */
const shown = (run, page, selector, what) =>
  page.waitForSelector(selector).then(() => run.expect(true, what), () => run.expect(false, what));

async function navigation(run) {
  const server = await run.server();
  const page = await run.open(server);
  for (const [name, address] of [['Jobs', '#/jobs'], ['API', '#/api'], ['Maps', '#/maps']]) {
    await page.click(`nav[aria-label=Main] a:text-is("${name}")`);
    await shown(run, page, `nav a[aria-current=page]:text-is("${name}")`, `${name} is marked in the header`);
    run.expect(page.url().endsWith(address), `${name} has an address: ${page.url()}`);
    run.expect((await page.title()).includes('stillmap'), `the window's title: ${await page.title()}`);
  }
  await page.goto(`${server.origin}/#/nothing/here`);
  await shown(run, page, 'text=This page does not exist', 'an unknown address is said');
  await page.keyboard.press('Tab');
  await server.stop();
}

async function colours(run) {
  const server = await run.server();
  const page = await run.open(server);
  const back = () => page.evaluate(() => getComputedStyle(document.documentElement).backgroundColor);
  const dark = await back();
  await page.click('button[title^="System"]');
  await page.click('button[title^="Dark"]');
  await page.waitForSelector('html[data-theme=light]');
  const light = await back();
  run.expect(dark !== light, `the colours change: ${dark}, ${light}`);
  await page.reload();
  await shown(run, page, 'html[data-theme=light]', 'the choice outlives a reload');
  await server.stop();
}

async function keys(run) {
  const server = await run.server();
  const key = run.stillmap('keys', 'create', 'viewer', '--store', server.store, '--scope', 'read');
  const page = await run.open(server, '#/maps');
  await shown(run, page, 'dialog:has-text("needs an API key")', 'a key is asked for');
  await run.accessible(page, 'the key dialog');
  await page.fill('dialog input', 'stillmap_wrong');
  await page.click('dialog button[type=submit]');
  await shown(run, page, 'dialog:has-text("does not accept this key")', 'a wrong key is refused in words');
  await run.screenshot(page, 'key_refused');
  await page.fill('dialog input', key);
  await page.keyboard.press('Enter');
  await shown(run, page, 'text="town"', 'with the key, what was asked for comes');
  await page.reload();
  await shown(run, page, 'text="town"', 'the key outlives a reload');
  await server.stop();
}

async function down(run) {
  const server = await run.server();
  const page = await run.open(server, '#/maps');
  await page.waitForSelector('text="town"');
  await server.stop();
  await page.click('nav a:text-is("Jobs")');
  await shown(run, page, '.connection.down', 'a server that is down is said in the header');
  await shown(run, page, '.trouble:has-text("does not answer")', 'and in the view, in words');
  await run.screenshot(page, 'server_down');
  await server.start();
  await page.waitForSelector('.connection.down', { state: 'detached' });
  await page.waitForSelector('.trouble', { state: 'detached' });
  run.expect(true, 'its return is noticed, and the view goes on by itself');
  await server.stop();
}

await main({ navigation, colours, keys, down });

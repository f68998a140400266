// Opens the page in Debian's Chromium against the real server and looks at what a person would see.
//
// usage: node page_test.mjs STILLMAP STORE [--screenshot FILE]
// Exit code 0, 1 (failed), 77 (skipped: no Chromium on this machine).

import { spawn } from 'node:child_process';
import { existsSync } from 'node:fs';
import { createRequire } from 'node:module';
import { createInterface } from 'node:readline';

const { chromium } = createRequire(new URL('../../web/package.json', import.meta.url))('playwright-core');

const kChromium = '/usr/bin/chromium';
const kFlags = [
  '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync', '--use-gl=angle', '--use-angle=swiftshader',
  '--enable-unsafe-swiftshader',
];
/** Least share of the canvas that is not background: a street from above covers more than this. */
const kLeastDrawn = 0.05;

const failures = [];
const expect = (holds, what) => {
  console.log(`${holds ? 'ok    ' : 'FAILED'} ${what}`);
  if (!holds) failures.push(what);
};

function startServer(program, store) {
  const server = spawn(program, ['serve', '--store', store, '--port', '0'], { stdio: ['ignore', 'pipe', 'ignore'] });
  return new Promise((resolve, reject) => {
    createInterface({ input: server.stdout }).on('line', (line) => {
      const address = /http:\/\/127\.0\.0\.1:\d+/.exec(line);
      if (address !== null) resolve({ server, origin: address[0] });
    });
    server.on('exit', (code) => reject(new Error(`stillmap serve ended with ${code}`)));
  });
}

async function untilReady(origin) {
  for (let tries = 0; tries < 100; ++tries) {
    if ((await fetch(`${origin}/readyz`)).ok) return;
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  throw new Error('the server was not ready within 10 s');
}

/** Share of a picture's pixels that differ from its most frequent colour. Decoded by the browser itself. */
function drawnShare(page, png) {
  return page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const picture = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
    const context = new OffscreenCanvas(picture.width, picture.height).getContext('2d');
    context.drawImage(picture, 0, 0);
    const pixels = new Uint32Array(context.getImageData(0, 0, picture.width, picture.height).data.buffer);
    const counts = new Map();
    for (const pixel of pixels) counts.set(pixel, (counts.get(pixel) ?? 0) + 1);
    return 1 - Math.max(...counts.values()) / pixels.length;
  }, png.toString('base64'));
}

async function check(page, origin, server, screenshot) {
  const errors = [];
  const foreign = [];
  page.on('console', (message) => message.type() === 'error' && errors.push(message.text()));
  page.on('pageerror', (error) => errors.push(String(error)));
  page.on('request', (request) => request.url().startsWith(origin) || foreign.push(request.url()));

  await page.goto(origin);
  await page.waitForSelector('body[data-state=ready]', { timeout: 60_000 });
  await page.waitForTimeout(500);
  if (screenshot !== undefined) await page.screenshot({ path: screenshot });
  const points = Number(await page.getAttribute('body', 'data-points'));
  expect(points > 10_000, `the page has points: ${points}`);
  const share = await drawnShare(page, await page.locator('#view').screenshot());
  expect(share > kLeastDrawn, `share of the canvas that is drawn on: ${share.toFixed(3)}`);
  expect((await page.textContent('#count-objects')) !== '0', 'removed objects are counted');

  for (const layer of ['measured', 'ground', 'projected', 'trajectory', 'objects']) await page.uncheck(`#show-${layer}`);
  await page.waitForTimeout(300);
  const empty = await drawnShare(page, await page.locator('#view').screenshot());
  expect(empty < 0.2 * share, `with all layers off little is left: ${empty.toFixed(3)}`);
  expect(errors.length === 0, `no console errors: ${errors.join(' | ')}`);
  expect(foreign.length === 0, `no request to another host: ${foreign.join(' ')}`);

  server.kill('SIGTERM');
  await new Promise((resolve) => server.once('close', resolve));
  await page.click('#reload');
  await page.waitForSelector('body[data-state=error]', { timeout: 20_000 });
  const said = await page.textContent('#message');
  expect(/does not answer/.test(said ?? ''), `a stopped server is said in words: ${said}`);
}

async function main() {
  const [program, store, flag, screenshot] = process.argv.slice(2);
  if (!existsSync(kChromium)) {
    console.log(`skipped: no ${kChromium}`);
    return 77;
  }
  if (store === undefined || (flag !== undefined && (flag !== '--screenshot' || screenshot === undefined))) {
    console.error('usage: page_test.mjs STILLMAP STORE [--screenshot FILE]');
    return 2;
  }
  const { server, origin } = await startServer(program, store);
  const browser = await chromium.launch({ executablePath: kChromium, args: kFlags });
  try {
    await untilReady(origin);
    await check(await browser.newPage({ viewport: { width: 1280, height: 720 }, colorScheme: 'dark' }), origin,
      server, screenshot);
  } finally {
    await browser.close();
    server.kill('SIGKILL');
  }
  console.log(failures.length === 0 ? 'the page works' : `${failures.length} expectations failed`);
  return failures.length === 0 ? 0 : 1;
}

process.exit(await main());

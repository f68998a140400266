// What the viewer costs in the browser, in software rendering: time to the first picture, script of a frame, and the time
// of a frame as a ratio to the same page with nothing drawn. Prints; judges nothing.
//
// usage: node page_frames.mjs STILLMAP SAMPLE [MAP]    SAMPLE as for tests/e2e

import { main } from '../e2e/harness.mjs';

const kCanvas = 'canvas.viewer-canvas';
const kTurns = 60;
const map = process.argv[4] ?? 'town';
process.argv.splice(4);

/** Turns the camera by key, a step a frame, and waits for the graphics at the end. @return [ms] a frame, and script [ms] */
function turn(page) {
  return page.evaluate(async ({ canvas: selector, turns }) => {
    const canvas = document.querySelector(selector);
    const gl = canvas.getContext('webgl2');
    const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
    const pixel = new Uint8Array(4);
    const wait = () => gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    wait();
    const begin = performance.now();
    for (let i = 0; i < turns; ++i) {
      canvas.dispatchEvent(new KeyboardEvent('keydown', { key: i % 2 === 0 ? 'ArrowLeft' : 'ArrowRight' }));
      await frame();
      wait();
    }
    const ms = (performance.now() - begin) / turns;
    await new Promise((resolve) => setTimeout(resolve, 1000));
    return { ms, script: Number(document.querySelector('[data-stat=script]').dataset.value) };
  }, { canvas: kCanvas, turns: kTurns });
}

async function frames(run) {
  const server = await run.server();
  for (let cold = 0; cold < 3; ++cold) {
    const begin = Date.now();
    const page = await run.open(server, `#/view/${map}`);
    await page.waitForFunction(() => Number(document.querySelector('[data-stat=points]')?.dataset.value ?? 0) > 0, undefined, { polling: 20 });
    console.log(`first picture ${Date.now() - begin} ms after the address was entered (window and engine cold)`);
    await page.context().close();
  }
  const page = await run.open(server, `#/view/${map}`);
  await page.waitForFunction(() => document.querySelector('[data-stat=pending]')?.dataset.value === '0', undefined, { polling: 500 });
  const shown = await turn(page);
  const points = await page.getAttribute('[data-stat=points]', 'data-value');
  for (const name of ['measured', 'ground', 'projected', 'filled', 'objects', 'trajectory']) await page.uncheck(`input[name=${name}]`);
  const empty = await turn(page);
  console.log(`script of a frame: ${shown.script.toFixed(2)} ms median with ${points} points, ${empty.script.toFixed(2)} ms with none`);
  console.log(`time of a frame: ${shown.ms.toFixed(1)} ms, ${(shown.ms / empty.ms).toFixed(1)} times that of an empty scene (${empty.ms.toFixed(1)} ms)`);
}

await main({ frames });

// Steps that several end-to-end tests take.

import { join } from 'node:path';

/** Whether an element comes within the patience, said as an expectation. @param options of waitForSelector */
export const shown = (run, page, selector, what, options = {}) =>
  page.waitForSelector(selector, options).then(() => run.expect(true, what), () => run.expect(false, `${what} (${selector})`));

/** Path of a scan of the sample drive. */
export const scanOf = (run, number) => join(run.sample, 'drive', 'velodyne', `${String(number).padStart(6, '0')}.bin`);

export async function middleOf(page, selector) {
  const { x, y, width, height } = await page.locator(selector).boundingBox();
  return [x + width / 2, y + height / 2];
}

/** Drops files on an element as the desktop does: by the browser's own input, not by a made-up event. */
export async function drop(page, selector, files) {
  const [x, y] = await middleOf(page, selector);
  const debug = await page.context().newCDPSession(page);
  const data = { items: [], files, dragOperationsMask: 1 };
  for (const type of ['dragEnter', 'dragOver', 'drop']) {
    await debug.send('Input.dispatchDragEvent', { type, x, y, data });
  }
  await debug.detach();
}

/** Waits until a condition on what the server says holds. */
export async function until(what, holds, seconds = 240) {
  for (let tries = 0; tries < 4 * seconds; ++tries) {
    if (await holds()) return;
    await new Promise((resolve) => setTimeout(resolve, 250));
  }
  throw new Error(`${what}: not within ${seconds} s`);
}

export const json = async (server, path, options) => (await fetch(`${server.origin}${path}`, options)).json();

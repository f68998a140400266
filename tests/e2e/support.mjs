// Steps that several end-to-end tests take.

import { createHash } from 'node:crypto';
import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';

/** Whether an element comes within the patience, said as an expectation. @param options of waitForSelector */
export const shown = (run, page, selector, what, options = {}) =>
  page.waitForSelector(selector, options).then(() => run.expect(true, what), () => run.expect(false, `${what} (${selector})`));

/** Path of a scan of the sample drive. */
export const scanOf = (run, number) => join(run.sample, 'drive', 'velodyne', `${String(number).padStart(6, '0')}.bin`);

export async function middleOf(page, selector) {
  const { x, y, width, height } = await page.locator(selector).boundingBox();
  return [x + width / 2, y + height / 2];
}

/** Metres that a region of a map package is wide. */
const kRegionM = 640;

/**
 * The sample's map with everything in it some regions to the east of where it is, and its origin where it was: tiles count
 * from their corner, so only the names of regions change, the map's extent, the poses and the objects.
 *
 * @return the package's folder.
 */
export function movedMap(run, regions) {
  const [from, to] = [join(run.sample, 'map'), join(run.scratch, `moved_${regions}`)];
  const shift = regions * kRegionM;
  const change = {
    'trajectory.tum': (text) => text.replace(/^(\S+) (\S+)/gm, (_, stamp, x) => `${stamp} ${Number(x) + shift}`),
    'objects.json': (text) => {
      const all = JSON.parse(text);
      for (const { placements } of all.objects) for (const { centre } of placements) centre[0] += shift;
      return JSON.stringify(all);
    },
  };
  const manifest = JSON.parse(readFileSync(join(from, 'manifest.json'), 'utf8'));
  const files = {};
  for (const [path, file] of Object.entries(manifest.files)) {
    const name = path.replace(/^regions\/(-?\d+)_/, (_, x) => `regions/${Number(x) + regions}_`);
    const bytes = readFileSync(join(from, path));
    const changed = change[path] === undefined ? bytes : Buffer.from(change[path](bytes.toString()));
    mkdirSync(dirname(join(to, name)), { recursive: true });
    writeFileSync(join(to, name), changed);
    files[name] = changed === bytes ? file : { bytes: changed.length, sha256: createHash('sha256').update(changed).digest('hex') };
  }
  const moved = ([x, ...others]) => [x + shift, ...others];
  const extent = { ...manifest.extent, min: moved(manifest.extent.min), max: moved(manifest.extent.max) };
  writeFileSync(join(to, 'manifest.json'), JSON.stringify({ ...manifest, files, extent }));
  writeFileSync(join(to, 'build.json'), readFileSync(join(from, 'build.json')));
  return { folder: to, shift };
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

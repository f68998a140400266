// A map in 3D: its points and layers, coordinates under the pointer, measuring, sections, clipping, export, objects,
// shared addresses, and what is said when something is missing.

import { readFileSync } from 'node:fs';
import { kPatienceMs, main } from './harness.mjs';
import { movedMap, until } from './support.mjs';

const kCanvas = 'canvas.viewer-canvas';
/** Small: rendering in software takes as long as there are pixels. */
const kSize = { width: 800, height: 480 };
/** Where buttons of a fixed size must not count. */
const kLargeSize = { width: 1000, height: 600 };
/** Least share of the picture that a street from above covers. */
const kLeastDrawn = 0.04;

const stat = (page, name) => page.evaluate((of) => Number(document.querySelector(`[data-stat=${of}]`)?.dataset.value ?? NaN), name);
const near = (a, b, tolerance) => Math.abs(a - b) <= tolerance;

/** Until all tiles of the view are there and the picture stands still. */
async function settled(page) {
  await page.waitForFunction(() => {
    const value = (name) => Number(document.querySelector(`[data-stat=${name}]`)?.dataset.value ?? -1);
    const now = `${value('frames')} ${value('points')}`;
    const same = now === globalThis.lastSeen;
    globalThis.lastSeen = now;
    return same && value('pending') === 0 && value('points') > 0;
  }, undefined, { polling: 700, timeout: kPatienceMs });
}

async function openView(run, server, query = '', size = kSize, map = 'town') {
  const page = await run.open(server, `#/view/${map}${query}`, { viewport: size });
  await page.waitForSelector(kCanvas);
  await settled(page);
  return page;
}

/** Share of the picture that is not its most frequent colour. Decoded by the browser itself. */
async function drawn(page) {
  const png = await page.locator(kCanvas).screenshot();
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

async function middle(page) {
  const { x, y, width, height } = await page.locator(kCanvas).boundingBox();
  return { x: x + width / 2, y: y + height / 2 };
}

/** Moves the pointer there and reads the coordinates that are shown. */
async function readOut(page, x, y) {
  await page.mouse.move(x - 3, y);
  await page.mouse.move(x, y);
  const place = page.locator('.viewer-readout .place').first();
  await place.waitFor();
  await page.waitForTimeout(200);
  return (await place.textContent()).match(/-?\d+\.\d+/g).map(Number);
}

/** Tiles of level 0. */
async function tilesOf(server, version) {
  const { tiles, next } = await (await fetch(`${server.origin}/v1/maps/town/versions/${version}/tiles?limit=1000`)).json();
  if (next !== null) throw new Error('more than 1000 tiles');
  return tiles.filter((tile) => tile.level === 0);
}

/** All points of full resolution in map coordinates, straight from the server. */
async function mapPoints(server) {
  const map = await (await fetch(`${server.origin}/v1/maps/town`)).json();
  const points = [];
  for (const { level, x, y } of await tilesOf(server, map.version)) {
    const path = `/v1/maps/town/versions/${map.version}/tiles/${level}/${x}/${y}`;
    const answer = await fetch(server.origin + path);
    const corner = answer.headers.get('Stillmap-Tile-Corner').split(',').map(Number);
    const view = new DataView(await answer.arrayBuffer());
    for (let at = 0; at < view.byteLength; at += 20) {
      const place = [0, 1, 2].map((axis) => view.getFloat32(at + 4 * axis, true) + corner[axis]);
      points.push({ place, intensity: view.getFloat32(at + 12, true), kind: view.getUint8(at + 18) });
    }
  }
  return { map, points };
}

async function pictures(run) {
  const server = await run.shared();
  const page = await openView(run, server, '', kLargeSize);
  const share = await drawn(page);
  run.expect(share > kLeastDrawn, `the map is drawn: ${share.toFixed(3)} of the picture`);
  await run.accessible(page, 'the viewer');
  await run.screenshot(page, 'view');
  const pictures = new Set();
  for (const colour of ['height', 'intensity', 'kind', 'observations']) {
    await page.selectOption('select[aria-label="Colour by"]', colour);
    await page.waitForTimeout(400);
    pictures.add((await page.locator(kCanvas).screenshot()).toString('base64'));
    await run.screenshot(page, `view_${colour}`);
  }
  run.expect(pictures.size === 4, 'each colouring makes another picture');
  for (const layer of ['measured', 'ground', 'projected', 'filled', 'objects', 'trajectory']) await page.uncheck(`input[name=${layer}]`);
  await page.waitForTimeout(400);
  const empty = await drawn(page);
  // The buttons above the picture are left.
  run.expect(empty < 0.25 * share, `with all layers off little is left: ${empty.toFixed(3)}`);
  await page.check('input[name=ground]');
  await page.waitForTimeout(400);
  run.expect((await drawn(page)) > 0.2 * share, 'one layer comes back alone');
}

async function idle(run) {
  const server = await run.shared();
  const page = await openView(run, server);
  // On a busy machine the last pictures come late; one that drew on and on would show within 2 s.
  const stands = async () => {
    const before = await stat(page, 'frames');
    await page.waitForTimeout(2000);
    return (await stat(page, 'frames')) === before;
  };
  let still = false;
  for (let tries = 0; tries < 10 && !still; ++tries) still = await stands();
  run.expect(still, 'a page left open draws nothing');
  const script = await page.evaluate(() => document.querySelector('[data-stat=script]').textContent);
  console.log(`       script a frame: ${script}`);
}

async function coordinates(run) {
  const server = await run.shared();
  const { points } = await mapPoints(server);
  const page = await openView(run, server);
  const { x, y } = await middle(page);
  const [px, py, pz] = await readOut(page, x, y);
  const nearest = points.reduce((least, { place }) => Math.min(least, Math.hypot(place[0] - px, place[1] - py, place[2] - pz)), Infinity);
  run.expect(nearest < 0.02, `the coordinates under the pointer are a point of the map: ${nearest.toFixed(3)} m`);

  await page.click('role=radio[name="Measure"]');
  const a = await readOut(page, x - 60, y);
  await page.mouse.click(x - 60, y);
  const b = await readOut(page, x + 80, y + 20);
  await page.mouse.click(x + 80, y + 20);
  const cells = await page.locator('.viewer-measures tbody tr td').allTextContents();
  const [straight, level] = cells.map((text) => Number.parseFloat(text));
  const truth = Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  run.expect(near(straight, truth, 0.03), `a measured length is that of its ends: ${straight} m, ${truth.toFixed(2)} m`);
  run.expect(near(level, Math.hypot(a[0] - b[0], a[1] - b[1]), 0.03), `and its level length: ${level} m`);
  await run.screenshot(page, 'view_measure');
  await page.focus(kCanvas);
  await page.keyboard.press('Enter');
  run.expect((await page.locator('.viewer-measures tbody tr').count()) === 3, 'the keyboard sets a place too');
  await page.keyboard.press('Backspace');
  run.expect((await page.locator('.viewer-measures tbody tr').count()) === 1, 'and takes it back');
  await page.keyboard.press('Escape');
  await page.waitForSelector('role=radio[name="Look"][checked]');
}

async function clipAndExport(run) {
  const server = await run.shared();
  const { points } = await mapPoints(server);
  const page = await openView(run, server);
  const { x, y } = await middle(page);
  await page.click('role=radio[name="Clip"]');
  await page.mouse.click(x - 100, y - 40);
  await page.mouse.click(x + 100, y + 60);
  await page.waitForSelector('section[aria-label="Clip box"]');
  await run.screenshot(page, 'view_clip');
  await page.waitForFunction(() => window.location.hash.includes('clip='));
  // The address is rounded: the box of what opens it is the one to compare with.
  const shared = new URL(page.url()).hash;
  const other = await openView(run, server, shared.slice(shared.indexOf('?')));
  const [, ...numbers] = new URLSearchParams(shared.slice(shared.indexOf('?'))).get('clip').split(',');
  const [cx, cy, cz, length, width, height] = numbers.map(Number);
  const inside = points.filter(({ place, kind }) => kind !== 0 && 2 * Math.abs(place[0] - cx) <= length &&
    2 * Math.abs(place[1] - cy) <= width && 2 * Math.abs(place[2] - cz) <= height);
  await other.uncheck('input[name=measured]');
  const [download] = await Promise.all([
    other.waitForEvent('download'), other.click('section[aria-label="Export"] button'),
  ]);
  const file = readFileSync(await download.path());
  const begin = file.indexOf('end_header\n') + 'end_header\n'.length;
  const view = new DataView(file.buffer, file.byteOffset + begin, file.length - begin);
  const found = Array.from({ length: view.byteLength / 31 }, (_, i) => [0, 8, 16].map((at) => view.getFloat64(31 * i + at, true)).join());
  const expected = inside.map(({ place }) => place.join());
  run.expect(expected.length > 0 && JSON.stringify(found.sort()) === JSON.stringify(expected.sort()),
    `the exported file has exactly the map's ${expected.length} points of the shown kinds in the box: ${found.length}`);
  run.expect(/^town-.*-clip\.ply$/.test(download.suggestedFilename()), `its name: ${download.suggestedFilename()}`);
  await other.click('text="Close the box"');
  run.expect((await other.locator('section[aria-label="Clip box"]').count()) === 0, 'the box can be removed');
}

async function section(run) {
  const server = await run.shared();
  const page = await openView(run, server);
  const { x, y } = await middle(page);
  await page.click('role=radio[name="Section"]');
  await page.mouse.click(x - 120, y);
  await page.mouse.click(x + 120, y + 10);
  await page.waitForSelector('.viewer-plot canvas');
  const text = await page.textContent('.viewer-profile header p');
  run.expect(Number(text.replace(/,/g, '').match(/\d+/)[0]) > 100, `a section has points: ${text}`);
  await page.waitForTimeout(500);
  await run.screenshot(page, 'view_section');
  await run.accessible(page, 'the viewer with a section');
  await page.click('button[aria-label="Close the section"]');
  run.expect((await page.locator('.viewer-plot').count()) === 0, 'it can be closed');
}

/** A view of one object from a little above. */
function cameraAt([x, y, z]) {
  return `?camera=${[x - 9, y - 9, z + 9, x, y, z].map((value) => value.toFixed(2)).join(',')}`;
}

async function objects(run) {
  const server = await run.shared();
  const { objects: list } = await (await fetch(`${server.origin}/v1/maps/town/versions/v1/objects`)).json();
  const target = list.find(({ motion }) => motion === 'parked') ?? list[0];
  const page = await openView(run, server, cameraAt(target.centre));
  const { x, y } = await middle(page);
  await page.mouse.click(x, y);
  await page.waitForSelector('.viewer-card');
  const card = await page.textContent('.viewer-card');
  run.expect(card.includes(target.class), `a click on a box tells about it: ${card.slice(0, 60)}`);
  await run.screenshot(page, 'view_object');
  await page.click('.viewer-card button:text-is("Keep")');
  await page.waitForSelector('.viewer-card button[aria-pressed=true]:text-is("Keep")');
  const { edits } = await (await fetch(`${server.origin}/v1/maps/town/edits`)).json();
  run.expect(edits.length === 1 && edits[0].action === 'keep' && edits[0].object.class === target.class,
    `what was decided is saved on the server: ${JSON.stringify(edits)}`);
  await page.reload();
  await settled(page);
  await page.mouse.click(x, y);
  await page.waitForSelector('.viewer-card button[aria-pressed=true]:text-is("Keep")');
  await page.click('.viewer-card button:text-is("Undo")');
  await page.waitForSelector('.viewer-card button[aria-pressed=true]', { state: 'detached' });
  run.expect((await (await fetch(`${server.origin}/v1/maps/town/edits`)).json()).edits.length === 0, 'and can be taken back');
}

async function painted(run) {
  const server = await run.shared();
  const page = await openView(run, server);
  for (const grid of ['coverage', 'localizability']) {
    const before = (await page.locator(kCanvas).screenshot()).toString('base64');
    await page.selectOption('select[aria-label="Ground colour"]', grid);
    await page.waitForSelector('section[aria-label="Ground colour"] .viewer-ramp');
    await page.waitForTimeout(500);
    const after = (await page.locator(kCanvas).screenshot()).toString('base64');
    run.expect(before !== after, `the ground is painted by ${grid}`);
    await run.screenshot(page, `view_${grid}`);
  }
}

async function sharing(run) {
  const server = await run.shared();
  const page = await openView(run, server);
  await page.focus(kCanvas);
  await page.keyboard.press('t');
  await page.keyboard.press('+');
  await page.selectOption('select[aria-label="Colour by"]', 'kind');
  await page.uncheck('input[name=objects]');
  await page.waitForFunction(() => window.location.hash.includes('colour=kind') && !window.location.hash.includes('objects'));
  await settled(page);
  await page.waitForTimeout(600);
  const address = new URL(page.url()).hash;
  const other = await openView(run, server, address.slice(address.indexOf('?')));
  run.expect((await other.inputValue('select[aria-label="Colour by"]')) === 'kind', 'a shared address brings the colours');
  run.expect(!(await other.isChecked('input[name=objects]')), 'and the layers');
  run.expect(new URL(other.url()).hash === address, `and stays as it is: ${address}`);
  // The first picture is from where the camera was before the address was rounded to centimetres.
  const third = await openView(run, server, address.slice(address.indexOf('?')));
  const [a, b] = await Promise.all([other, third].map((one) => one.locator(kCanvas).screenshot()));
  run.expect(a.equals(b), 'two that open it see the same picture, pixel by pixel');
}

async function trouble(run) {
  const server = await run.shared();
  const page = await run.open(server, '#/maps');
  const said = (words) => page.waitForSelector(`.viewer-message:has-text("${words}")`).then(
    () => run.expect(true, `said: ${words}`), () => run.expect(false, `said: ${words}`));
  await page.route('**/*.glb', (route) => route.abort());
  await page.goto(`${server.origin}/#/view/town`);
  await said('The picture stays; the missing tiles are loaded when the server answers');
  await page.unroute('**/*.glb');
  await page.click('.viewer-message button');
  await settled(page);
  run.expect((await page.locator('.viewer-message').count()) === 0, 'and forgotten once it goes on');

  await page.goto(`${server.origin}/#/maps`);
  await page.route('**/*.glb', (route) => route.fulfill({
    status: 404, contentType: 'application/problem+json', body: '{"title": "Not found", "code": "UnknownVersion", "detail": "no version v1"}',
  }));
  await page.goto(`${server.origin}/#/view/town`);
  await said('This version was deleted from the server');
  await page.unroute('**/*.glb');

  await page.goto(`${server.origin}/#/view/nowhere`);
  await page.waitForSelector('.trouble:has-text("cannot be shown")');
  run.expect(true, 'a map that is not there is said');
}

async function far(run) {
  const server = await run.shared();
  const { folder, shift } = movedMap(run, 1562);
  run.stillmap('store', 'add', server.store, 'far', 'v1', folder, '--activate');
  await until('the far map is served', async () => (await fetch(`${server.origin}/v1/maps/far`)).ok);
  const { points, map } = await mapPoints(server);
  // In steps that a sum with the shift keeps exactly.
  const at = points[Math.floor(points.length / 2)].place.map((value) => Math.round(64 * value) / 64);
  run.expect(map.origin[0] < 1000 && shift > 999_000, `the map is moved by ${shift} m from its origin`);
  // So near that the floats of 1,000 km, 60 mm apart, would show. Colours by height follow the tile that came first.
  const pictures = [];
  for (const [name, moved] of [['town', 0], ['far', shift]]) {
    const camera = [at[0] + moved - 3, at[1] - 3, at[2] + 3, at[0] + moved, at[1], at[2]];
    const page = await openView(run, server, `?camera=${camera.join()}&with=objects.trajectory&colour=kind`, kSize, name);
    await page.waitForSelector('label:has-text("Trajectory") >> text=/\\d/');
    await run.screenshot(page, `view_at_${name}`);
    pictures.push({ page, moved, png: await page.locator(kCanvas).screenshot() });
  }
  const [here, there] = pictures;
  run.expect(here.png.equals(there.png), 'a map 1,000 km from its origin is the same picture, pixel by pixel');
  const { x, y } = await middle(there.page);
  const under = async ({ page, moved }) => {
    const [px, py, pz] = await readOut(page, x, y);
    return [px - moved, py, pz];
  };
  const found = await under(there);
  const nearest = points.reduce((least, { place }) => Math.min(least, apart(place, found)), Infinity);
  run.expect(nearest < 0.02, `the coordinates under the pointer are a point of it: ${nearest.toFixed(3)} m`);
  const off = apart(await under(here), found);
  run.expect(off < 0.011, `and the same point is under the pointer: ${off.toFixed(3)} m`);
}

/** Eye and target of the view that the address names. */
const cameraOf = (page) => page.evaluate(() => {
  const [ex, ey, ez, ...target] = new URLSearchParams(location.hash.split('?')[1]).get('camera').split(',').map(Number);
  return { eye: [ex, ey, ez], target };
});
const apart = (a, b) => Math.hypot(...a.map((value, i) => value - b[i]));

async function clipped(run) {
  const server = await run.shared();
  const page = await openView(run, server);
  // A box over the middle third of the map, with the ground and no more than the feet of what stands on it.
  const { version, origin } = await (await fetch(`${server.origin}/v1/maps/town`)).json();
  const tiles = await tilesOf(server, version);
  const [low, high] = [0, 1, 2].map((axis) => origin[axis] + Math.min(...tiles.map(({ min }) => min[axis])))
    .map((value, axis) => [value, origin[axis] + Math.max(...tiles.map(({ max }) => max[axis]))])
    .reduce(([lows, highs], [a, b]) => [[...lows, a], [...highs, b]], [[], []]);
  const centre = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2] + 1.25];
  const size = [(high[0] - low[0]) / 3, (high[1] - low[1]) / 3, 2.5];
  const box = (mode) => `?clip=${mode},${[...centre, ...size].map((value) => value.toFixed(2)).join()},0`;
  const eye = [centre[0] - 1, centre[1] - 45, centre[2] + 40];
  const place = `camera=${[...eye, ...centre].map((value) => value.toFixed(2)).join()}`;
  await page.goto(`${server.origin}/#/view/town${box('inside')}&${place}`);
  await page.waitForSelector('section[aria-label="Clip box"]');
  await settled(page);
  await run.screenshot(page, 'view_clip_inside');
  const { x, y } = await middle(page);
  for (const [dx, dy] of [[0, 0], [-90, 30], [120, -20], [40, 60]]) {
    const [px, py, pz] = await readOut(page, x + dx, y + dy);
    const text = await page.textContent('.viewer-readout');
    run.expect(/no point here/.test(text) || (2 * Math.abs(px - centre[0]) <= size[0] + 0.02 && 2 * Math.abs(py - centre[1]) <= size[1] + 0.02
      && Math.abs(pz - centre[2]) <= size[2] / 2 + 0.02), `what a box cuts away is not pointed at: ${text.slice(0, 60)}`);
  }

  const sizes = () => page.locator('section[aria-label="Clip box"] input').evaluateAll((all) => all.map((input) => Number(input.value)));
  const before = await sizes();
  // Nothing but the box is left, so that where it stands in the picture is where its mark is.
  const mark = await page.evaluate(({ eye: from, centre: at, face }) => {
    // The camera's own axes, as it looks from `from` at `at` with z up.
    const minus = (a, b) => a.map((value, i) => value - b[i]);
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const unit = (a) => a.map((value) => value / Math.hypot(...a));
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const ahead = unit(minus(at, from));
    const right = unit(cross(ahead, [0, 0, 1]));
    const up = cross(right, ahead);
    const { left, top, width, height } = document.querySelector('canvas.viewer-canvas').getBoundingClientRect();
    const seen = minus(face, from);
    const scale = height / 2 / Math.tan(Math.PI / 8) / dot(seen, ahead);
    return { x: left + width / 2 + scale * dot(seen, right), y: top + height / 2 - scale * dot(seen, up), perM: scale };
  }, { eye, centre, face: [centre[0] + size[0] / 2, centre[1], centre[2]] });
  await page.mouse.move(mark.x, mark.y);
  await page.mouse.down();
  await page.mouse.move(mark.x + mark.perM, mark.y, { steps: 3 });
  await page.mouse.move(mark.x + 3 * mark.perM, mark.y, { steps: 3 });
  await page.mouse.up();
  const after = await sizes();
  run.expect(near(after[3], before[3] + 3, 0.3) && near(after[0], before[0] + 1.5, 0.15) && near(after[4], before[4], 0.01),
    `a face of the box is pulled by its mark: ${before.slice(0, 5)} to ${after.slice(0, 5)}`);
  run.expect(apart((await cameraOf(page)).eye, eye) < 0.05, 'and the camera stands still');
  await page.waitForFunction((length) => Math.abs(Number(location.hash.split('clip=')[1]?.split(/,|%2C/)[4]) - length) < 0.01, after[3]);
  run.expect(true, 'the address has the box as it is');
}

/** Fingers on the picture: places of each, at each step. */
async function fingers(page, ...steps) {
  const debug = await page.context().newCDPSession(page);
  const points = (places) => places.map(([x, y], id) => ({ x, y, id }));
  await debug.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: points(steps[0].slice(0, 1)) });
  if (steps[0].length > 1) await debug.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: points(steps[0]) });
  for (const places of steps.slice(1)) await debug.send('Input.dispatchTouchEvent', { type: 'touchMove', touchPoints: points(places) });
  await debug.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
  await debug.detach();
  await page.waitForTimeout(900);
}

async function touch(run) {
  const server = await run.shared();
  const page = await run.open(server, '#/view/town', { hasTouch: true, viewport: { width: 400, height: 800 } });
  await page.waitForSelector(kCanvas);
  await settled(page);
  await page.waitForFunction(() => location.hash.includes('camera='));
  await run.screenshot(page, 'view_narrow');
  const { x, y } = await middle(page);
  await fingers(page, [[x, y]]);
  run.expect(/^x -?\d/.test(await page.textContent('.viewer-readout .place')), 'a tap reads coordinates');

  const steps = (from, to) => [0, 0.25, 0.5, 0.75, 1].map((share) => from.map((place, i) => place.map((value, axis) => value + share * (to[i][axis] - value))));
  const [first] = [await cameraOf(page)];
  await fingers(page, ...steps([[x - 60, y]], [[x + 60, y]]));
  const turned = await cameraOf(page);
  run.expect(apart(turned.target, first.target) < 0.05 && apart(turned.eye, first.eye) > 5
    && near(apart(turned.eye, turned.target), apart(first.eye, first.target), 0.1), 'one finger turns it');
  await fingers(page, ...steps([[x - 30, y], [x + 30, y]], [[x - 90, y], [x + 90, y]]));
  const nearer = await cameraOf(page);
  run.expect(apart(nearer.eye, nearer.target) < 0.7 * apart(turned.eye, turned.target),
    `two fingers that part come nearer: ${apart(turned.eye, turned.target).toFixed(1)} m, ${apart(nearer.eye, nearer.target).toFixed(1)} m`);
  await fingers(page, ...steps([[x - 40, y], [x + 40, y]], [[x - 40, y + 80], [x + 40, y + 80]]));
  const moved = await cameraOf(page);
  run.expect(apart(moved.target, nearer.target) > 1 && near(apart(moved.eye, moved.target), apart(nearer.eye, nearer.target), 1),
    `two fingers that go together move it: by ${apart(moved.target, nearer.target).toFixed(1)} m`);

  await page.click('role=radio[name="Measure"]');
  // The first finger stands still: alone it would be a tap.
  await fingers(page, ...steps([[x, y], [x + 30, y]], [[x, y], [x + 90, y]]));
  run.expect((await page.locator('section[aria-label="Measurement"]').count()) === 0, 'two fingers set no place');
  await fingers(page, [[x, y]]);
  run.expect((await page.locator('section[aria-label="Measurement"]').count()) === 1, 'one that taps does');
}

async function revoked(run) {
  const server = await run.server();
  const made = (name, ...scopes) => run.stillmap('keys', 'create', name, '--store', server.store, ...scopes.flatMap((scope) => ['--scope', scope]));
  const [admin, reader, other] = [made('admin', 'admin'), made('reader', 'read'), made('other', 'read')];
  const headers = { Authorization: `Bearer ${admin}` };
  const page = await run.open(server, '#/maps');
  await page.fill('dialog input', reader);
  await page.keyboard.press('Enter');
  await page.waitForSelector('text="town"');
  const held = [];
  let holds = true;
  const first = new Promise((resolve) => page.route('**/*.glb', (route) => (holds ? resolve(held.push(route)) : route.continue())));
  await page.goto(`${server.origin}/#/view/town`);
  await first;
  const { keys } = await (await fetch(`${server.origin}/v1/keys`, { headers })).json();
  await fetch(`${server.origin}/v1/keys/${keys.find(({ name }) => name === 'reader').id}`, { method: 'DELETE', headers });
  holds = false;
  for (const route of held) await route.continue();
  await page.waitForSelector('dialog:has-text("does not accept this key")');
  run.expect(true, 'a key that is revoked while tiles come is asked for again');
  // Tiles that were asked for before the dialog may be refused behind it.
  const asked = new Set();
  let refusals = 0;
  page.on('request', (request) => asked.add(request));
  page.on('response', (response) => (refusals += response.status() === 401 && asked.has(response.request()) ? 1 : 0));
  await page.keyboard.press('Escape');
  await page.waitForSelector('.viewer-message:has-text("The picture stays")');
  await page.waitForTimeout(5000);
  run.expect((await page.locator('dialog').count()) === 0 && refusals === 0, `a closed dialog stays closed, and nothing is asked in vain: ${refusals}`);
  await page.click('.viewer-message button');
  await page.fill('dialog input', other);
  await page.keyboard.press('Enter');
  await settled(page);
  run.expect((await page.locator('.viewer-message').count()) === 0, 'with another key the tiles come, by themselves');
  await server.stop();
}

async function graphics(run) {
  const server = await run.shared();
  const page = await openView(run, server);
  await page.evaluate((canvas) => {
    globalThis.lost = document.querySelector(canvas).getContext('webgl2').getExtension('WEBGL_lose_context');
    globalThis.lost.loseContext();
  }, kCanvas);
  await page.waitForSelector('.viewer-message:has-text("lost the graphics context")');
  run.expect(true, 'a lost picture is said');
  await page.evaluate(() => globalThis.lost.restoreContext());
  await page.waitForSelector('.viewer-message', { state: 'detached' });
  await page.waitForTimeout(1500);
  run.expect((await drawn(page)) > kLeastDrawn, 'and comes back');

  const without = await run.open(server, '#/maps');
  await without.addInitScript(() => {
    const real = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
      return kind.startsWith('webgl') ? null : real.call(this, kind, ...rest);
    };
  });
  run.expectedErrors.push(/WebGL/);
  await without.goto(`${server.origin}/?again#/view/town`);
  await without.waitForSelector('.viewer-message:has-text("WebGL 2 is missing")');
  run.expect(true, 'a browser without WebGL is told so');
}

await main({ pictures, idle, coordinates, clipAndExport, section, objects, painted, sharing, far, clipped, touch, trouble, revoked, graphics });

// What every end-to-end test of the page needs: the real server on a store of its own, Debian's Chromium, a list of
// expectations, and an eye on console errors, foreign requests and accessibility.
//
// A test file is called as `node NAME_test.mjs STILLMAP SAMPLE [--screenshots FOLDER]`; SAMPLE is the folder that
// tests/integration/sample_map.sh made: drive/, map/ (a package) and store/ with town v1 active.
// Exit code 0, 1 (failed), 77 (skipped: no Chromium on this machine). ONLY=part,part in the environment runs these alone.

import { spawn, spawnSync } from 'node:child_process';
import { cpSync, existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { createInterface } from 'node:readline';

const require = createRequire(new URL('../../web/package.json', import.meta.url));
const { chromium } = require('playwright-core');
const kAxe = readFileSync(require.resolve('axe-core/axe.min.js'), 'utf8');

const kChromium = '/usr/bin/chromium';
const kFlags = [
  '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync', '--use-gl=angle', '--use-angle=swiftshader',
  '--enable-unsafe-swiftshader',
];
/** Longest that anything on the page may take on a loaded machine [ms]. */
export const kPatienceMs = 60_000;

/** A running `stillmap serve`. */
class Server {
  constructor(program, store, options) {
    this.program = program;
    this.store = store;
    this.options = options;
  }

  /** Starts it, on the port of before if it ran already, and waits until its maps are ready. */
  async start() {
    const args = ['serve', '--store', this.store, '--port', String(this.port ?? 0), ...this.options];
    this.process = spawn(this.program, args, { stdio: ['ignore', 'pipe', 'pipe'] });
    this.said = '';
    this.process.stderr.on('data', (text) => (this.said += text));
    this.origin = await new Promise((found, reject) => {
      createInterface({ input: this.process.stdout }).on('line', (line) => {
        const address = /http:\/\/127\.0\.0\.1:\d+/.exec(line);
        if (address !== null) found(address[0]);
      });
      this.process.once('exit', (code) => reject(new Error(`stillmap serve ended with ${code}: ${this.said}`)));
    });
    this.port = Number(new URL(this.origin).port);
    for (let tries = 0; tries < 200; ++tries) {
      if ((await fetch(`${this.origin}/readyz`)).ok) return this;
      await new Promise((done) => setTimeout(done, 100));
    }
    throw new Error('the server was not ready within 20 s');
  }

  /** @param signal SIGTERM lets it end what it does. */
  async stop(signal = 'SIGTERM') {
    if (this.process === undefined || this.process.exitCode !== null) return;
    const ended = new Promise((done) => this.process.once('close', done));
    this.process.kill(signal);
    await ended;
  }
}

/** One test run: what it has, what it found. */
export class Run {
  failures = [];
  errors = [];
  foreign = [];
  /** Console errors that the part under way brings about itself, as those of requests that are refused; with their addresses. */
  expectedErrors = [];
  #servers = [];
  #shared;

  constructor(program, sample, screenshots) {
    this.program = program;
    // Absolute, as the browser takes files that are dropped.
    this.sample = resolve(sample);
    this.screenshots = screenshots;
    this.scratch = mkdtempSync(join(tmpdir(), 'stillmap-e2e-'));
    if (screenshots !== undefined) mkdirSync(screenshots, { recursive: true });
  }

  expect(holds, what) {
    console.log(`${holds ? 'ok    ' : 'FAILED'} ${what}`);
    if (!holds) this.failures.push(what);
  }

  /** A server on a fresh copy of the sample store, or on an empty store. @param options further ones of `serve` */
  async server({ empty = false, options = [] } = {}) {
    const store = join(this.scratch, `store${this.#servers.length}`);
    if (empty) mkdirSync(store);
    else cpSync(join(this.sample, 'store'), store, { recursive: true });
    const server = new Server(this.program, store, options);
    this.#servers.push(server);
    return server.start();
  }

  /** One server on the sample store for all parts of a test that ask for it: a part finds what those before it left. */
  async shared() {
    return (this.#shared ??= await this.server());
  }

  /** Runs the program; its stdout, trimmed. @throws Error when it fails */
  stillmap(...args) {
    const { status, stdout, stderr } = spawnSync(this.program, args, { encoding: 'utf8' });
    if (status !== 0) throw new Error(`stillmap ${args.join(' ')} ended with ${status}: ${stderr}`);
    return stdout.trim();
  }

  /** A tar of a folder, of the sample unless absolute, as a person would upload it. @return its path */
  tar(folder, name = `${folder}.tar`) {
    const path = join(this.scratch, name);
    const { status } = spawnSync('tar', ['cf', path, '-C', resolve(this.sample, folder), '.']);
    if (status !== 0) throw new Error(`tar of ${folder} failed`);
    return path;
  }

  /** A new window with nothing remembered. @param options of Playwright's newContext */
  async open(server, place = '', options = {}) {
    const context = await this.browser.newContext({
      viewport: { width: 1280, height: 800 }, colorScheme: 'dark', reducedMotion: 'reduce', ...options,
    });
    const page = await context.newPage();
    page.setDefaultTimeout(kPatienceMs);
    this.latest = page;
    page.on('console', (message) => {
      const text = `${message.text()} ${message.location().url}`;
      if (message.type() !== 'error' || this.expectedErrors.some((known) => known.test(text))) return;
      this.errors.push(text);
    });
    page.on('pageerror', (error) => this.errors.push(String(error)));
    page.on('request', (request) => {
      const url = request.url();
      if (!url.startsWith(server.origin) && !url.startsWith('blob:') && !url.startsWith('data:')) this.foreign.push(url);
    });
    await page.goto(`${server.origin}/${place}`);
    return page;
  }

  async screenshot(page, name) {
    if (this.screenshots !== undefined) await page.screenshot({ path: join(this.screenshots, `${name}.png`) });
  }

  /** No fault that axe-core calls serious or critical. */
  async accessible(page, what) {
    // By the debugger, since the page's policy lets no foreign script in.
    await page.evaluate(kAxe);
    const { violations } = await page.evaluate(() => globalThis.axe.run(document, { resultTypes: ['violations'] }));
    const grave = violations.filter(({ impact }) => impact === 'serious' || impact === 'critical');
    const words = grave.map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => node.html).join(' ')}`);
    this.expect(grave.length === 0, `${what}: no serious accessibility fault ${words.join(' | ')}`);
  }

  async close() {
    this.expect(this.errors.length === 0, `no console errors ${this.errors.join(' | ')}`);
    this.expect(this.foreign.length === 0, `no request to another host ${this.foreign.join(' ')}`);
    await this.browser?.close();
    for (const server of this.#servers) await server.stop('SIGKILL');
    rmSync(this.scratch, { recursive: true, force: true });
  }
}

/** Runs the parts of a test one after the other, each also when one before failed, and ends the process. */
export async function main(parts) {
  const [program, sample, flag, screenshots] = process.argv.slice(2);
  if (sample === undefined || (flag !== undefined && (flag !== '--screenshots' || screenshots === undefined))) {
    console.error('usage: node NAME_test.mjs STILLMAP SAMPLE [--screenshots FOLDER]');
    process.exit(2);
  }
  if (!existsSync(kChromium)) {
    console.log(`skipped: no ${kChromium}`);
    process.exit(77);
  }
  const run = new Run(program, sample, screenshots);
  try {
    run.browser = await chromium.launch({ executablePath: kChromium, args: kFlags });
    const only = process.env.ONLY?.split(',');
    for (const [name, part] of Object.entries(parts).filter(([one]) => only?.includes(one) ?? true)) {
      console.log(`-- ${name}`);
      run.expectedErrors = [/Failed to load resource/];
      const begin = performance.now();
      await part(run).catch(async (error) => {
        run.expect(false, `${name}: ${error.stack}`);
        await run.screenshot(run.latest, `failed_${name}`).catch(() => undefined);
      });
      // Windows left open would go on asking for their server, and keep their graphics.
      for (const context of run.browser.contexts()) await context.close();
      console.log(`   ${name}: ${((performance.now() - begin) / 1000).toFixed(1)} s`);
    }
  } finally {
    await run.close();
  }
  console.log(run.failures.length === 0 ? 'all holds' : `${run.failures.length} expectations failed`);
  process.exit(run.failures.length === 0 ? 0 : 1);
}

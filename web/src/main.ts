import { ApiError, createApi, type MapList } from './api.js';
import type { Theme } from './colour.js';
import { loadMap } from './load.js';
import { element, Panel } from './panel.js';
import { Viewer } from './viewer.js';

const kLight = window.matchMedia('(prefers-color-scheme: light)');
const theme = (): Theme => (kLight.matches ? 'light' : 'dark');

const api = createApi((...request) => fetch(...request));
const panel = new Panel();
let current = new AbortController();

/** Name of the map in the address, as in `#map=town`; empty when there is none. */
function mapInAddress(): string {
  return new URLSearchParams(window.location.hash.slice(1)).get('map') ?? '';
}

/** Asks the server anew and shows the map of the address, or the first one. A call ends the one before. */
async function show(viewer: Viewer): Promise<void> {
  current.abort();
  current = new AbortController();
  const { signal } = current;
  panel.clearProgress();
  panel.setState('loading', 'Asking the server for its maps…');
  try {
    const list = await api.maps(signal);
    const name = mapInAddress() || (list.maps[0]?.name ?? '');
    panel.setMaps(list, name);
    clear(viewer);
    if (!list.maps.some((map) => map.name === name)) {
      panel.setState(name === '' ? 'ready' : 'error', 'No map is shown', missing(list, name));
      return;
    }
    document.title = `${name} – stillmap`;
    panel.setState('loading', `Loading ${name}…`, refusals(list));
    const failures = await loadMap(api, name, viewer, panel, signal);
    const message = [failures, refusals(list)].filter((text) => text !== '').join('\n');
    panel.setState(failures === '' ? 'ready' : 'error', failures === '' ? 'All tiles are shown' : 'Incomplete', message);
  } catch (error) {
    if (signal.aborted) return;
    if (!(error instanceof ApiError)) console.error(error);
    panel.setState('error', 'Not loaded', (error as Error).message);
  }
}

function clear(viewer: Viewer): void {
  viewer.begin([], 0.1);
  panel.setFacts(undefined);
  panel.setPoints(undefined);
  panel.setHeights(undefined);
}

function missing(list: MapList, name: string): string {
  if (list.refused.some((map) => map.name === name)) return refusals(list);
  if (name !== '') return `The server has no map named “${name}”. Choose one from the list.`;
  return [
    'The server holds no maps yet. Make one with “stillmap build DRIVE -o STORE/NAME”, then restart the server.',
    refusals(list),
  ].filter((text) => text !== '').join('\n');
}

function refusals(list: MapList): string {
  return list.refused.map((map) => `The server could not load the map “${map.name}”: ${map.reason}`).join('\n');
}

function start(): void {
  const canvas = element<HTMLCanvasElement>('view');
  let viewer: Viewer;
  try {
    viewer = new Viewer(canvas, theme());
  } catch (error) {
    console.error(error);
    panel.setState('error', 'Not loaded', 'This browser cannot draw in 3D: WebGL 2 is missing or switched off.');
    return;
  }
  canvas.addEventListener('webglcontextlost', () =>
    panel.setState('error', 'The picture is gone', 'The graphics card gave up the picture. Reload the page.'));
  kLight.addEventListener('change', () => {
    viewer.setTheme(theme());
    panel.setTheme(theme());
  });
  panel.setTheme(theme());
  panel.onPart((part, visible) => viewer.setVisible(part, visible));
  panel.onReload(() => void show(viewer));
  panel.onMap((name) => {
    window.location.hash = new URLSearchParams({ map: name }).toString();
  });
  window.addEventListener('hashchange', () => void show(viewer));
  element('show-all').addEventListener('click', () => viewer.showAll());
  element('show-above').addEventListener('click', () => viewer.showFromAbove());
  void show(viewer);
}

start();

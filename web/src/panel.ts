import type { MapDetails, MapList } from './api.js';
import { heightRamp, type Theme } from './colour.js';
import { kLayers, type Layer } from './tile.js';
import { kParts, type Part } from './viewer.js';

/** What the page tells tests and style sheets about itself. */
export type State = 'loading' | 'ready' | 'error';

const kNumber = new Intl.NumberFormat('en-GB');

/** The element with that id. @throws Error when the page has none: page and script do not belong together. */
export function element<Type extends HTMLElement>(id: string): Type {
  const found = document.getElementById(id);
  if (found === null) throw new Error(`the page has no element #${id}`);
  return found as Type;
}

/** All of the page that is not the picture: reads choices, writes words and numbers. */
export class Panel {
  private readonly map_ = element<HTMLSelectElement>('map');
  private readonly progress_ = element<HTMLProgressElement>('progress');

  onMap(chosen: (name: string) => void): void {
    this.map_.addEventListener('change', () => chosen(this.map_.value));
  }

  onReload(pressed: () => void): void {
    element('reload').addEventListener('click', pressed);
  }

  onPart(switched: (part: Part, visible: boolean) => void): void {
    for (const part of kParts) {
      const box = element<HTMLInputElement>(`show-${part}`);
      box.addEventListener('change', () => switched(part, box.checked));
      // Browsers keep a box as it was over a reload.
      switched(part, box.checked);
    }
  }

  /** @param message in words, for the state `error` or for a map list that is empty. */
  setState(state: State, text: string, message = ''): void {
    document.body.dataset['state'] = state;
    element('progress-text').textContent = text;
    const box = element('message');
    box.textContent = message;
    box.hidden = message === '';
  }

  setProgress(done: number, total: number): void {
    this.progress_.max = total;
    this.progress_.value = done;
    element('progress-text').textContent = `Loading the map: tile ${kNumber.format(done)} of ${kNumber.format(total)}`;
  }

  /** No number of tiles is known yet. */
  clearProgress(): void {
    this.progress_.removeAttribute('value');
  }

  /** @param chosen name to show as chosen; one that is not in the list leaves nothing chosen. */
  setMaps(list: MapList, chosen: string): void {
    this.map_.replaceChildren(
      ...list.maps.map((map) => new Option(map.name, map.name, false, map.name === chosen)),
      ...list.refused.map((map) => {
        const option = new Option(`${map.name} (not loaded)`, map.name);
        option.disabled = true;
        return option;
      }),
    );
    if (!list.maps.some((map) => map.name === chosen)) this.map_.selectedIndex = -1;
    this.map_.disabled = list.maps.length === 0;
  }

  setFacts(map: MapDetails | undefined): void {
    element('version').textContent = map === undefined ? '' : `Version ${map.version}`;
    element('fact-tiles').textContent = map === undefined ? '–' : kNumber.format(map.tiles.length);
    element('fact-objects').textContent = map === undefined ? '–' : kNumber.format(map.objects);
    element('fact-voxel').textContent = map === undefined ? '–' : `${map.voxel_size_m} m`;
    element('fact-frame').textContent = map === undefined ? '–' : map.frame_id;
    this.setCount('trajectory', map?.poses);
    this.setCount('objects', map?.objects);
  }

  setPoints(counts: Readonly<Record<Layer, number>> | undefined): void {
    for (const layer of kLayers) this.setCount(layer, counts?.[layer]);
    const total = counts === undefined ? 0 : kLayers.reduce((sum, layer) => sum + counts[layer], 0);
    element('fact-points').textContent = counts === undefined ? '–' : kNumber.format(total);
    document.body.dataset['points'] = String(total);
  }

  /** @param low, high in map coordinates [m]; undefined while there are no points. */
  setHeights(range: { low: number; high: number } | undefined): void {
    const text = (height: number | undefined): string => (height === undefined ? '–' : `${height.toFixed(1)} m`);
    element('height-low').textContent = text(range?.low);
    element('height-high').textContent = text(range?.high);
  }

  setTheme(theme: Theme): void {
    const canvas = element<HTMLCanvasElement>('ramp');
    const ramp = new Uint8ClampedArray(heightRamp(canvas.width, theme));
    canvas.getContext('2d')?.putImageData(new ImageData(ramp, canvas.width, 1), 0, 0);
  }

  private setCount(part: Part, count: number | undefined): void {
    element(`count-${part}`).textContent = count === undefined ? '' : kNumber.format(count);
  }
}

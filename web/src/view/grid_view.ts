import { isAborted, toApiError } from '../api/errors.js';
import type { GridLayer } from '../scene/grid_layer.js';
import { cellsOf, type Cells } from '../scene/grid_map.js';
import { Histogram } from '../scene/statistics.js';
import type { RampName } from '../scene/colour_maps.js';
import type { Range, Theme, Vec3 } from '../scene/types.js';
import type { Grid } from '../scene/view_state.js';
import { Store } from '../state/store.js';
import { loadGrid, type GridAnswer, type MapFacts } from './facts.js';

/** How a grid is coloured. */
interface GridKind {
  readonly band: string;
  readonly ramp: RampName;
  readonly holds: (value: number) => boolean;
  /** Fixed, or computed from the values. */
  readonly range?: Range;
}

export const kGridKinds: Record<Exclude<Grid, 'none'>, GridKind> = {
  coverage: { band: 'observations', ramp: 'amount', holds: (value) => value > 0 },
  localizability: { band: 'localizability', ramp: 'quality', holds: () => true, range: { low: 0, high: 1 } },
};

export type GridState =
  | { readonly state: 'none' | 'loading' }
  | { readonly state: 'shown'; readonly range: Range; readonly cells: number }
  | { readonly state: 'failed'; readonly text: string };

/** The coloured ground: loaded when first wanted, then kept. */
export class GridView {
  readonly state = new Store<GridState>({ state: 'none' });
  private readonly answers_ = new Map<Grid, GridAnswer>();
  private wanted_: Grid = 'none';
  private drawn_ = '';

  constructor(
    private readonly layer_: GridLayer,
    private readonly facts_: MapFacts,
    private readonly signal_: AbortSignal,
    private readonly onChange_: () => void,
  ) {}

  get group() {
    return this.layer_.group;
  }

  show(grid: Grid, theme: Theme): void {
    this.wanted_ = grid;
    if (grid === 'none') {
      this.drawn_ = '';
      this.layer_.clear();
      this.state.set({ state: 'none' });
    } else if (this.answers_.has(grid)) {
      this.draw(grid, theme);
    } else if (this.drawn_ !== grid) {
      this.drawn_ = grid;
      void this.load(grid, theme);
    }
  }

  private async load(grid: Exclude<Grid, 'none'>, theme: Theme): Promise<void> {
    this.layer_.clear();
    this.state.set({ state: 'loading' });
    try {
      this.answers_.set(grid, await loadGrid(this.facts_, grid, kGridKinds[grid].band, this.signal_));
      if (this.wanted_ === grid) this.draw(grid, theme);
    } catch (error) {
      if (isAborted(error) || this.wanted_ !== grid) return;
      this.drawn_ = '';
      this.state.set({ state: 'failed', text: toApiError(error).message });
    }
  }

  private draw(grid: Exclude<Grid, 'none'>, theme: Theme): void {
    const key = `${grid} ${theme}`;
    if (key === this.drawn_) return;
    this.drawn_ = key;
    const { head, heights, values } = this.answers_.get(grid) as GridAnswer;
    const kind = kGridKinds[grid];
    const cells = cellsOf(head, heights, values, kind.holds);
    const range = kind.range ?? rangeOf(cells);
    this.layer_.show(cells, head.origin as unknown as Vec3, range, kind.ramp, theme);
    this.state.set({ state: 'shown', range, cells: cells.count });
    this.onChange_();
  }
}

function rangeOf(cells: Cells): Range {
  const histogram = new Histogram(1);
  cells.value.forEach((value) => histogram.add(value));
  return histogram.range(0.02, 1) ?? { low: 0, high: 1 };
}

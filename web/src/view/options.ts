import type { Box, ClipMode } from '../scene/clip_box.js';
import type { Quality } from '../scene/scene.js';
import { kColourings, kKinds, type Colouring, type Kind } from '../scene/types.js';
import type { Grid, Overlay, ViewState } from '../scene/view_state.js';

/** What the person has chosen to see. */
export interface Options {
  readonly colouring: Colouring;
  readonly kinds: readonly Kind[];
  readonly overlays: readonly Overlay[];
  readonly grid: Grid;
  readonly clip: { readonly box: Box; readonly mode: ClipMode } | undefined;
  readonly eyeDome: boolean;
  readonly quality: Quality;
  /** Points drawn at most. */
  readonly budget: number;
}

export const kBudgets: readonly number[] = [500_000, 1_000_000, 2_000_000, 4_000_000, 8_000_000];

/** The defaults, with the values of an address. */
export function optionsOf(state: ViewState): Options {
  return {
    colouring: state.colouring ?? kColourings[0],
    kinds: state.kinds ?? kKinds,
    overlays: state.overlays ?? ['objects', 'trajectory'],
    grid: state.grid ?? 'none',
    clip: state.clip,
    eyeDome: true,
    quality: 'auto',
    budget: 2_000_000,
  };
}

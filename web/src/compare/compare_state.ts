/** How two versions are shown: one over the other, or side by side. */
export type Layout = 'swipe' | 'side';

/** The part of a comparison that is kept in the address, so that it can be shared. */
export interface CompareState {
  layout: Layout;
  /** Share of the picture's width that shows A, in [0, 1]. */
  split: number;
  above: boolean;
  difference: boolean;
  /** Distance from which a point counts as different [m]; null = the server's default. */
  tolerance_m: number | null;
}

export const kCompareDefaults: CompareState = {
  layout: 'swipe', split: 0.5, above: false, difference: true, tolerance_m: null,
};

/** The server's bounds. */
export const kToleranceBounds_m = { min: 0.01, max: 2 } as const;

/** Values that cannot be read keep their defaults: people type addresses. */
export function readCompareState(query: URLSearchParams): CompareState {
  const split = Number(query.get('split') ?? kCompareDefaults.split);
  const tolerance_m = Number(query.get('tolerance_m') ?? Number.NaN);
  return {
    layout: query.get('layout') === 'side' ? 'side' : 'swipe',
    split: split >= 0 && split <= 1 ? split : kCompareDefaults.split,
    above: query.get('above') === '1',
    difference: query.get('difference') !== '0',
    tolerance_m: tolerance_m >= kToleranceBounds_m.min && tolerance_m <= kToleranceBounds_m.max ? tolerance_m : null,
  };
}

/** Writes only values that differ from the defaults, so that addresses stay short; other keys are kept. */
export function writeCompareState(state: CompareState, query: URLSearchParams): URLSearchParams {
  const written = new URLSearchParams(query);
  const put = (key: string, value: string | null): void => {
    if (value === null) written.delete(key);
    else written.set(key, value);
  };
  put('layout', state.layout === 'side' ? 'side' : null);
  put('split', state.split === kCompareDefaults.split ? null : String(Number(state.split.toFixed(3))));
  put('above', state.above ? '1' : null);
  put('difference', state.difference ? null : '0');
  put('tolerance_m', state.tolerance_m === null ? null : String(state.tolerance_m));
  return written;
}

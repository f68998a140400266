import type { Box, ClipMode } from './clip_box.js';
import { kColourings, kKinds, type Colouring, type Kind, type Vec3 } from './types.js';

/** What can be drawn in addition to the points. */
export const kOverlays = ['objects', 'trajectory', 'keyframes', 'loops'] as const;
export type Overlay = (typeof kOverlays)[number];

/** Values that can colour the ground. */
export const kGrids = ['none', 'coverage', 'localizability'] as const;
export type Grid = (typeof kGrids)[number];

/** The content of a shared address; map coordinates [m]. Missing values have the page's defaults. */
export interface ViewState {
  readonly eye?: Vec3;
  readonly target?: Vec3;
  readonly colouring?: Colouring;
  readonly kinds?: readonly Kind[];
  readonly overlays?: readonly Overlay[];
  readonly grid?: Grid;
  readonly clip?: { readonly box: Box; readonly mode: ClipMode };
}

/** The state as the query of an address; centimetres are precise enough for an eye. */
export function writeViewState(state: ViewState): URLSearchParams {
  const query = new URLSearchParams();
  if (state.eye !== undefined && state.target !== undefined) {
    query.set('camera', numbers([...state.eye, ...state.target]));
  }
  if (state.colouring !== undefined) query.set('colour', state.colouring);
  if (state.kinds !== undefined) query.set('points', list(state.kinds));
  if (state.overlays !== undefined) query.set('with', list(state.overlays));
  if (state.grid !== undefined && state.grid !== 'none') query.set('grid', state.grid);
  if (state.clip !== undefined) {
    const { box, mode } = state.clip;
    query.set('clip', `${mode},${numbers([...box.centre, ...box.size])},${box.yaw.toFixed(4)}`);
  }
  return query;
}

/** The state of an address. Invalid values are left out: an address can come from anywhere. */
export function readViewState(query: URLSearchParams): ViewState {
  const camera = finite((query.get('camera') ?? '').split(','), 6);
  const colouring = kColourings.find((name) => name === query.get('colour'));
  const grid = kGrids.find((name) => name === query.get('grid'));
  const kinds = names(kKinds, query.get('points'));
  const overlays = names(kOverlays, query.get('with'));
  const clip = readClip(query.get('clip'));
  return {
    ...(camera && { eye: triple(camera, 0), target: triple(camera, 3) }),
    ...(colouring && { colouring }),
    ...(kinds && { kinds }),
    ...(overlays && { overlays }),
    ...(grid && { grid }),
    ...(clip && { clip }),
  };
}

function readClip(text: string | null): ViewState['clip'] {
  const [mode, ...rest] = (text ?? '').split(',');
  const values = finite(rest, 7);
  if (values === undefined || (mode !== 'inside' && mode !== 'outside')) return undefined;
  const size = triple(values, 3);
  if (!size.every((length) => length > 0)) return undefined;
  return { mode, box: { centre: triple(values, 0), size, yaw: values[6] as number } };
}

function numbers(values: readonly number[]): string {
  return values.map((value) => String(Number(value.toFixed(2)))).join(',');
}

function list(values: readonly string[]): string {
  return values.length === 0 ? 'none' : values.join('.');
}

function names<Name extends string>(known: readonly Name[], text: string | null): Name[] | undefined {
  if (text === null) return undefined;
  const said = text.split('.');
  return known.filter((name) => said.includes(name));
}

function finite(texts: readonly string[], count: number): number[] | undefined {
  const values = texts.map((text) => (text.trim() === '' ? NaN : Number(text)));
  return values.length === count && values.every((value) => Math.abs(value) < 1e9) ? values : undefined;
}

function triple(values: readonly number[], from: number): Vec3 {
  return [values[from] as number, values[from + 1] as number, values[from + 2] as number];
}

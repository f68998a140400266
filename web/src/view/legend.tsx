import { useEffect, useRef } from 'preact/hooks';
import { kKindColours, ramp, type RampName } from '../scene/colour_maps.js';
import { objectColour } from '../scene/object_colours.js';
import { rampOf } from '../scene/point_materials.js';
import { kTrackColours } from '../scene/track_layer.js';
import type { Kind, Theme } from '../scene/types.js';
import { useStore } from '../state/store.js';
import { theme } from '../ui/theme.js';
import { kGridKinds } from './grid_view.js';
import type { ViewerModel } from './model.js';

/** The meaning of the point colours. */
export function ColourLegend({ model }: { model: ViewerModel }) {
  const { colouring } = useStore(model.options);
  const ranges = useStore(model.ranges);
  if (colouring === 'kind') return null;
  const { low, high } = ranges?.[colouring] ?? {};
  const digits = colouring === 'observations' ? 0 : colouring === 'height' ? 1 : 2;
  const unit = colouring === 'height' ? ' m' : '';
  const text = (value: number | undefined): string => (value === undefined ? '–' : `${value.toFixed(digits)}${unit}`);
  return <Ramp name={rampOf(colouring)} low={text(low)} high={text(high)} what={colouring} />;
}

/** The meaning of the ground colours. */
export function GridLegend({ model }: { model: ViewerModel }) {
  const { grid } = useStore(model.options);
  const now = useStore(model.grid.state);
  if (grid === 'none') return null;
  if (now.state === 'loading') return <p class="quiet" role="status">Loading…</p>;
  if (now.state === 'failed') return <p class="fault" role="alert">{now.text}</p>;
  if (now.state !== 'shown') return null;
  const [low, high] = grid === 'localizability'
    ? ['unconstrained in one direction', 'constrained in all directions']
    : [`${now.range.low.toFixed(0)}`, `${now.range.high.toFixed(0)} observations per cell`];
  return <Ramp name={kGridKinds[grid].ramp} low={low} high={high} what={grid} />;
}

function Ramp({ name, low, high, what }: { name: RampName; low: string; high: string; what: string }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const now = useStore(theme);
  useEffect(() => {
    const context = canvas.current?.getContext('2d');
    context?.putImageData(new ImageData(new Uint8ClampedArray(ramp(name, 256, now)), 256, 1), 0, 0);
  }, [name, now]);
  return (
    <figure class="viewer-ramp">
      <canvas ref={canvas} width={256} height={1} role="img" aria-label={`Colours of ${what} from ${low} to ${high}`} />
      <figcaption><span>{low}</span><span>{high}</span></figcaption>
    </figure>
  );
}

/** A patch in the colour of something in the picture. */
export function swatchOf(what: 'kind' | 'overlay' | 'class', name: string) {
  return <Swatch colour={(now) => colourOf(what, name, now)} round={what === 'overlay' && name === 'keyframes'} />;
}

function Swatch({ colour, round }: { colour: (theme: Theme) => string; round: boolean }) {
  const now = useStore(theme);
  return <span class={round ? 'swatch round' : 'swatch'} style={{ background: colour(now) }} />;
}

function colourOf(what: 'kind' | 'overlay' | 'class', name: string, now: Theme): string {
  if (what === 'kind') return `rgb(${kKindColours[now][name as Kind].join(' ')})`;
  const colour = what === 'class' ? objectColour(name, now)
    : name === 'objects' ? objectColour('car', now) : kTrackColours[now][name as 'trajectory' | 'keyframes' | 'loops'];
  return `#${colour.toString(16).padStart(6, '0')}`;
}

import { linkTo } from '../state/router.js';
import { kColourings, kKinds, type Colouring, type Kind } from '../scene/types.js';
import { kGrids, kOverlays, type Grid, type Overlay } from '../scene/view_state.js';
import { short } from '../ui/format.js';
import { useStore } from '../state/store.js';
import { ClipPanel } from './clip_panel.js';
import { DrawingPanel } from './drawing_panel.js';
import { ExportPanel } from './export_panel.js';
import { ColourLegend, GridLegend, swatchOf } from './legend.js';
import { MeasurePanel } from './measure_panel.js';
import type { ViewerModel } from './model.js';
import { Section } from './section.js';

const kColouringWords: Record<Colouring, string> = {
  height: 'Height', intensity: 'Intensity', kind: 'Kind', observations: 'Observations',
};
const kKindWords: Record<Kind, string> = {
  measured: 'Measured', ground: 'Ground', projected: 'Projected to ground', filled: 'Filled ground',
};
const kOverlayWords: Record<Overlay, string> = {
  objects: 'Removed objects', trajectory: 'Trajectory', keyframes: 'Keyframes', loops: 'Loop closures',
};
const kGridWords: Record<Grid, string> = { none: 'None', coverage: 'Coverage', localizability: 'Localizability' };

/** The panel left of the picture: what is shown, and how. */
export function Panel({ model }: { model: ViewerModel }) {
  const { facts } = model;
  return (
    <>
      <header class="viewer-title">
        <h1>{facts.name}</h1>
        <p class="quiet"><a href={linkTo('maps', [facts.name])}>Version {facts.version}</a></p>
      </header>
      <Section title="Colour"><ColourChoice model={model} /></Section>
      <Section title="Points"><KindChoice model={model} /></Section>
      <Section title="Overlays"><OverlayChoice model={model} /></Section>
      <Section title="Ground colour"><GridChoice model={model} /></Section>
      <MeasurePanel model={model} />
      <ClipPanel model={model} />
      <ExportPanel model={model} />
      <DrawingPanel model={model} />
      <Help />
    </>
  );
}

function ColourChoice({ model }: { model: ViewerModel }) {
  const { colouring } = useStore(model.options);
  return (
    <>
      <select
        aria-label="Colour by" value={colouring}
        onChange={({ currentTarget }) => model.change({ colouring: currentTarget.value as Colouring })}
      >
        {kColourings.map((name) => <option key={name} value={name}>{kColouringWords[name]}</option>)}
      </select>
      <ColourLegend model={model} />
    </>
  );
}

function KindChoice({ model }: { model: ViewerModel }) {
  const { kinds, colouring } = useStore(model.options);
  return (
    <div class="viewer-checks">
      {kKinds.map((kind) => (
        <label key={kind} class="viewer-check">
          <input
            type="checkbox" name={kind} checked={kinds.includes(kind)}
            onChange={({ currentTarget }) => model.change({ kinds: toggled(kKinds, kinds, kind, currentTarget.checked) })}
          />
          {colouring === 'kind' && swatchOf('kind', kind)}
          <span>{kKindWords[kind]}</span>
        </label>
      ))}
    </div>
  );
}

function OverlayChoice({ model }: { model: ViewerModel }) {
  const { overlays } = useStore(model.options);
  const signs = useStore(model.signs);
  const counts: Record<Overlay, string> = {
    objects: signs === undefined ? '' : short(signs.objects.length),
    trajectory: signs === undefined ? '' : short(signs.poses.length),
    keyframes: signs === undefined ? '' : short(signs.keyframes.length),
    loops: signs === undefined ? '' : signs.loops === undefined ? 'unknown' : short(signs.loops.length),
  };
  return (
    <div class="viewer-checks">
      {kOverlays.map((overlay) => (
        <label key={overlay} class="viewer-check">
          <input
            type="checkbox" name={overlay} checked={overlays.includes(overlay)}
            onChange={({ currentTarget }) => model.change({ overlays: toggled(kOverlays, overlays, overlay, currentTarget.checked) })}
          />
          {swatchOf('overlay', overlay)}
          <span>{kOverlayWords[overlay]}</span>
          <output>{counts[overlay]}</output>
        </label>
      ))}
      {overlays.includes('objects') && <ObjectLegend model={model} />}
    </div>
  );
}

function ObjectLegend({ model }: { model: ViewerModel }) {
  const signs = useStore(model.signs);
  const counts = new Map<string, number>();
  for (const object of signs?.objects ?? []) counts.set(object.class, (counts.get(object.class) ?? 0) + 1);
  return (
    <ul class="viewer-classes">
      {[...counts].sort((a, b) => b[1] - a[1]).map(([name, count]) => (
        <li key={name}>{swatchOf('class', name)} {name} <span class="quiet">{count}</span></li>
      ))}
    </ul>
  );
}

function GridChoice({ model }: { model: ViewerModel }) {
  const { grid } = useStore(model.options);
  return (
    <>
      <select
        aria-label="Ground colour" value={grid}
        onChange={({ currentTarget }) => model.change({ grid: currentTarget.value as Grid })}
      >
        {kGrids.map((name) => <option key={name} value={name}>{kGridWords[name]}</option>)}
      </select>
      <GridLegend model={model} />
    </>
  );
}

function Help() {
  return (
    <details class="viewer-help">
      <summary>Mouse and keyboard</summary>
      <dl>
        <div><dt>Rotate</dt><dd>drag, or <kbd>←</kbd> <kbd>→</kbd> <kbd>↑</kbd> <kbd>↓</kbd></dd></div>
        <div><dt>Move</dt><dd>right drag, or <kbd>Shift</kbd> with arrow keys</dd></div>
        <div><dt>Zoom</dt><dd>wheel, or <kbd>+</kbd> <kbd>−</kbd></dd></div>
        <div><dt>Move closer</dt><dd>double click</dd></div>
        <div><dt>Whole map</dt><dd><kbd>0</kbd></dd></div>
        <div><dt>From above</dt><dd><kbd>T</kbd></dd></div>
        <div><dt>Set a point</dt><dd>click, or <kbd>Enter</kbd> for the middle</dd></div>
        <div><dt>Remove the last point</dt><dd><kbd>Backspace</kbd></dd></div>
        <div><dt>End the tool</dt><dd><kbd>Esc</kbd></dd></div>
      </dl>
      <p class="quiet">Keys work while the picture has the focus: click it first.</p>
    </details>
  );
}

function toggled<Name>(all: readonly Name[], chosen: readonly Name[], name: Name, on: boolean): Name[] {
  return all.filter((one) => (one === name ? on : chosen.includes(one)));
}

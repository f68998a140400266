import { useEffect, useRef, useState } from 'preact/hooks';
import { isAborted, toApiError } from '../api/errors.js';
import { go, linkTo, replaceQuery } from '../state/router.js';
import type { Scene } from '../scene/scene.js';
import type { Trouble as TileTrouble } from '../scene/tile_source.js';
import { readViewState, writeViewState } from '../scene/view_state.js';
import { Icon } from '../ui/icon.js';
import { CopyButton } from '../ui/parts.js';
import { SceneCanvas } from '../ui/scene_canvas.js';
import { useStore } from '../state/store.js';
import { theme } from '../ui/theme.js';
import { CompareScene } from './compare_scene.js';
import { kToleranceBounds_m, readCompareState, writeCompareState, type CompareState } from './compare_state.js';
import { biggestPlaces } from './difference.js';
import { DifferencePanel, type DifferenceState } from './difference_panel.js';
import { Divider } from './divider.js';
import { difference, type Version } from './routes.js';

interface Props {
  map: string;
  a: Version;
  b: Version;
  names: readonly string[];
  query: URLSearchParams;
}

const kMostPlaces = 12;
/** Bounds of the radius that a place is looked at with [m]. */
const kLook_m = { least: 4, most: 18 } as const;

/** Two versions in one picture, with what differs beside it. */
export function Comparison({ map, a, b, names, query }: Props) {
  const [state, setState] = useState(() => readCompareState(query));
  const [found, setFound] = useState<DifferenceState>({ kind: 'making', progress: null });
  const [turn, setTurn] = useState(0);
  const [chosen, setChosen] = useState<number | null>(null);
  const [drawn, setDrawn] = useState<number | null>(null);
  const [trouble, setTrouble] = useState<TileTrouble>();
  const [scene, setScene] = useState<Scene>();
  const shown = useRef<CompareScene>();
  const current = useRef(state);
  current.current = state;
  const colours = useStore(theme);
  const change = (part: Partial<CompareState>): void => setState((before) => ({ ...before, ...part }));

  useEffect(() => {
    if (scene === undefined) return undefined;
    const made = new CompareScene(scene, map, { a, b }, theme.get(), setTrouble);
    shown.current = made;
    const { eye, target } = readViewState(query);
    made.setLayout(current.current.layout, current.current.split);
    void Promise.all([made.a.ready, made.b.ready]).then(() => {
      frame(scene, current.current.above);
      if (eye !== undefined && target !== undefined) scene.setView({ eye, target });
    }, () => undefined);
    const forget = scene.onView(() => share(scene, current.current));
    return () => {
      forget();
      shown.current = undefined;
      made.dispose();
    };
  }, [scene]);
  useEffect(() => shown.current?.setTheme(colours), [colours, scene]);
  useEffect(() => shown.current?.setLayout(state.layout, state.split), [state.layout, state.split, scene]);
  useEffect(() => share(scene, state), [state]);

  useEffect(() => {
    const stop = new AbortController();
    setFound({ kind: 'making', progress: null });
    setChosen(null);
    difference(map, b.name, a.name, state.tolerance_m, (progress) => setFound({ kind: 'making', progress }), stop.signal).then(
      (ready) => setFound({ kind: 'ready', difference: ready, places: biggestPlaces(ready.tiles, kMostPlaces) }),
      (error: unknown) => isAborted(error) || setFound({ kind: 'failed', error: toApiError(error) }));
    return () => stop.abort();
  }, [state.tolerance_m, turn]);
  useEffect(() => {
    setDrawn(null);
    const ready = found.kind === 'ready' && state.difference ? found.difference : null;
    void shown.current?.showDifference(ready).then(setDrawn, () => undefined);
  }, [found, state.difference, scene]);

  const look = (index: number): void => {
    if (found.kind !== 'ready' || scene === undefined) return;
    const place = found.places[index]!;
    const { origin } = found.difference;
    setChosen(index);
    shown.current?.markPlace(place, origin);
    const middle = [0, 1, 2].map((axis) => origin[axis]! + (place.min[axis]! + place.max[axis]!) / 2) as [number, number, number];
    const radius = Math.hypot(place.max[0] - place.min[0], place.max[1] - place.min[1]) / 5;
    scene.lookAtPlace(middle, Math.min(kLook_m.most, Math.max(kLook_m.least, radius)));
  };
  const above = (on: boolean): void => {
    change({ above: on });
    if (scene !== undefined) frame(scene, on);
  };

  return (
    <div class="compare beside-stage">
      <div class="beside">
        <div class="beside-body">
          <h1 class="title">{map}: before and after</h1>
          <VersionPair map={map} a={a.name} b={b.name} names={names} />
          <fieldset class="how">
            <legend>Lay them</legend>
            {([['swipe', 'Over each other, with a line'], ['side', 'Beside each other']] as const).map(([layout, words]) => (
              <label key={layout} class="choice">
                <input type="radio" name="layout" value={layout} checked={state.layout === layout} onChange={() => change({ layout })} />
                <span>{words}</span>
              </label>
            ))}
          </fieldset>
          <div class="row">
            <label class="inline">
              <input type="checkbox" checked={state.above} onChange={(event) => above(event.currentTarget.checked)} /><span>From above</span>
            </label>
            <label class="inline">
              <input type="checkbox" checked={state.difference} onChange={(event) => change({ difference: event.currentTarget.checked })} />
              <span>Highlight what differs</span>
            </label>
          </div>
          <Tolerance value={state.tolerance_m ?? (found.kind === 'ready' ? found.difference.tolerance_m : null)} onValue={(tolerance_m) => change({ tolerance_m })} />
          <DifferencePanel state={found} a={a.name} b={b.name} chosen={chosen} onPlace={look} onRetry={() => setTurn(turn + 1)} />
          {found.kind === 'ready' && drawn !== null && drawn < found.difference.only_in_other.points + found.difference.only_in_version.points && state.difference && (
            <p class="remark">Too much differs to draw all of it: the {drawn.toLocaleString('en')} points of the most changed tiles are highlighted.</p>
          )}
          <div class="row"><ShareButton /></div>
        </div>
      </div>
      <div class="stage">
        <SceneCanvas
          origin={a.origin} onScene={setScene}
          label={`Versions ${a.name} and ${b.name} of ${map} in 3D. Arrow keys turn them, Shift with arrow keys moves them, plus and minus zoom, 0 shows all.`}
        />
        <p class="side-label a"><span class="swatch" /> {a.name}</p>
        <p class="side-label b">{b.name} <span class="swatch" /></p>
        {state.layout === 'swipe'
          ? <Divider share={state.split} onShare={(split) => change({ split })} a={a.name} b={b.name} />
          : <div class="middle" aria-hidden="true" />}
        {trouble !== undefined && (
          <div class="stage-trouble trouble" role="alert">
            <p>{trouble.text}</p>
            <button type="button" onClick={() => shown.current?.retry()}>Try again</button>
          </div>
        )}
      </div>
    </div>
  );
}

function frame(scene: Scene, above: boolean): void {
  if (above) scene.showFromAbove();
  else scene.showAll();
}

/** Writes the address, so that it shows the same when it is opened elsewhere. */
function share(scene: Scene | undefined, state: CompareState): void {
  const query = writeCompareState(state, scene === undefined ? new URLSearchParams() : writeViewState(scene.view));
  replaceQuery(Object.fromEntries(query));
}

function VersionPair({ map, a, b, names }: { map: string; a: string; b: string; names: readonly string[] }) {
  const choose = (first: string, second: string): void => go(linkTo('compare', [map, first, second]));
  const options = names.map((name) => <option key={name} value={name}>{name}</option>);
  return (
    <div class="pair">
      <label class="pair-a"><span>Left</span><select value={a} onChange={(event) => choose(event.currentTarget.value, b)}>{options}</select></label>
      <button type="button" class="plain" aria-label={`Swap ${a} and ${b}`} title="Swap" onClick={() => choose(b, a)}><Icon name="compare" /></button>
      <label class="pair-b"><span>Right</span><select value={b} onChange={(event) => choose(a, event.currentTarget.value)}>{options}</select></label>
    </div>
  );
}

function Tolerance({ value, onValue }: { value: number | null; onValue: (tolerance_m: number) => void }) {
  const { min, max } = kToleranceBounds_m;
  return (
    <label class="inline tolerance">
      <span>A point counts when the other has none within</span>
      <input
        type="number" min={100 * min} max={100 * max} step={1} value={value === null ? '' : Math.round(100 * value)}
        onChange={(event) => {
          const metres = event.currentTarget.valueAsNumber / 100;
          if (metres >= min && metres <= max) onValue(metres);
        }}
      />
      <span>cm</span>
    </label>
  );
}

/** The address changes without the page being drawn anew, so it is read when it is asked for. */
function ShareButton() {
  const [text, setText] = useState(window.location.href);
  return (
    <span onPointerEnter={() => setText(window.location.href)} onFocusCapture={() => setText(window.location.href)}>
      <CopyButton text={text} label="Copy a link to this view" />
    </span>
  );
}

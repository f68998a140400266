import { useEffect, useRef, useState } from 'preact/hooks';
import { isAborted, toApiError } from '../api/errors.js';
import { go, linkTo, replaceQuery } from '../state/router.js';
import type { Scene } from '../scene/scene.js';
import type { Trouble as TileTrouble } from '../scene/tile_source.js';
import { readViewState, writeViewState } from '../scene/view_state.js';
import { Icon } from '../ui/icon.js';
import { CopyButton } from '../ui/parts.js';
import { SceneCanvas, StageTrouble } from '../ui/scene_canvas.js';
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
/** Bounds of the radius that is shown around a place [m]. */
const kLook_m = { least: 4, most: 18 } as const;

/** Two versions in one picture, with their differences beside it. */
export function Comparison({ map, a, b, names, query }: Props) {
  const [state, setState] = useState(() => readCompareState(query));
  const [chosen, setChosen] = useState<number | null>(null);
  const [trouble, setTrouble] = useState<TileTrouble>();
  const [scene, setScene] = useState<Scene>();
  const { found, retry } = useDifference(map, a, b, state.tolerance_m);
  const pair = usePair(scene, { map, a, b }, state, query, setTrouble);
  const drawn = useDrawnDifference(pair, found, state.difference);
  const change = (part: Partial<CompareState>): void => setState((before) => ({ ...before, ...part }));
  useEffect(() => setChosen(null), [found.kind]);

  const look = (index: number): void => {
    if (found.kind !== 'ready' || scene === undefined) return;
    const place = found.places[index]!;
    const { origin } = found.difference;
    setChosen(index);
    pair?.markPlace(place, origin);
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
          <HowToShow state={state} onChange={change} onAbove={above} />
          <Tolerance value={state.tolerance_m ?? (found.kind === 'ready' ? found.difference.tolerance_m : null)} onValue={(tolerance_m) => change({ tolerance_m })} />
          <DifferencePanel state={found} a={a.name} b={b.name} chosen={chosen} onPlace={look} onRetry={retry} />
          {drawn !== null && drawn < pointsThatDiffer(found) && (
            <p class="remark">The versions differ too much to highlight every point. Highlighted are {drawn.toLocaleString('en')} points, in the most changed tiles.</p>
          )}
          <div class="row"><ShareButton /></div>
        </div>
      </div>
      <div class="stage">
        <SceneCanvas
          origin={a.scene_origin} onScene={setScene}
          label={`Versions ${a.name} and ${b.name} of ${map} in 3D. Arrow keys turn them, Shift with arrow keys moves them, plus and minus zoom, 0 shows all.`}
        />
        <p class="side-label a"><span class="swatch" /> {a.name}</p>
        <p class="side-label b">{b.name} <span class="swatch" /></p>
        {state.layout === 'swipe'
          ? <Divider share={state.split} onShare={(split) => change({ split })} a={a.name} b={b.name} />
          : <div class="middle" aria-hidden="true" />}
        <StageTrouble text={trouble?.text} onRetry={() => pair?.retry()} />
      </div>
    </div>
  );
}

/** The differences as the server counts them, asked for again with every tolerance. */
function useDifference(map: string, a: Version, b: Version, tolerance_m: number | null): { found: DifferenceState; retry: () => void } {
  const [found, setFound] = useState<DifferenceState>({ kind: 'making', progress: null });
  const [turn, setTurn] = useState(0);
  useEffect(() => {
    const stop = new AbortController();
    setFound({ kind: 'making', progress: null });
    difference({ map, version: b.name, other: a.name }, tolerance_m, (progress) => setFound({ kind: 'making', progress }), stop.signal).then(
      (ready) => setFound({ kind: 'ready', difference: ready, places: biggestPlaces(ready.tiles, kMostPlaces) }),
      (error: unknown) => isAborted(error) || setFound({ kind: 'failed', error: toApiError(error) }));
    return () => stop.abort();
  }, [tolerance_m, turn]);
  return { found, retry: () => setTurn((before) => before + 1) };
}

/** Both versions in the scene; the address follows the camera and the choices. */
function usePair(
  scene: Scene | undefined, versions: { map: string; a: Version; b: Version }, state: CompareState, query: URLSearchParams,
  onTrouble: (trouble: TileTrouble | undefined) => void,
): CompareScene | undefined {
  const [pair, setPair] = useState<CompareScene>();
  const current = useRef(state);
  current.current = state;
  const colours = useStore(theme);
  useEffect(() => {
    if (scene === undefined) return undefined;
    const made = new CompareScene(scene, versions.map, versions, theme.get(), onTrouble);
    setPair(made);
    const { eye, target } = readViewState(query);
    made.setLayout(current.current.layout, current.current.split);
    void Promise.all([made.a.ready, made.b.ready]).then(() => {
      frame(scene, current.current.above);
      if (eye !== undefined && target !== undefined) scene.setView({ eye, target });
    }, () => undefined);
    const forget = scene.onView(() => share(scene, current.current));
    return () => {
      forget();
      setPair(undefined);
      made.dispose();
    };
  }, [scene]);
  useEffect(() => pair?.setTheme(colours), [colours, pair]);
  useEffect(() => pair?.setLayout(state.layout, state.split), [state.layout, state.split, pair]);
  useEffect(() => share(scene, state), [state]);
  return pair;
}

/** Highlights the differences if wanted. @return how many points of them are drawn, null until that is known. */
function useDrawnDifference(pair: CompareScene | undefined, found: DifferenceState, wanted: boolean): number | null {
  const [drawn, setDrawn] = useState<number | null>(null);
  useEffect(() => {
    setDrawn(null);
    const isShown = wanted && found.kind === 'ready';
    void pair?.showDifference(isShown ? found.difference : null).then((count) => isShown && setDrawn(count), () => undefined);
  }, [pair, found, wanted]);
  return drawn;
}

function pointsThatDiffer(found: DifferenceState): number {
  return found.kind === 'ready' ? found.difference.only_in_other.points + found.difference.only_in_version.points : 0;
}

function frame(scene: Scene, above: boolean): void {
  if (above) scene.showFromAbove();
  else scene.showAll();
}

/** Writes the address, so that it shows the same view when somebody else opens it. */
function share(scene: Scene | undefined, state: CompareState): void {
  const query = writeCompareState(state, scene === undefined ? new URLSearchParams() : writeViewState(scene.view));
  replaceQuery(Object.fromEntries(query));
}

function HowToShow({ state, onChange, onAbove }: {
  state: CompareState; onChange: (part: Partial<CompareState>) => void; onAbove: (on: boolean) => void;
}) {
  return (
    <>
      <fieldset class="how">
        <legend>Show the versions</legend>
        {([['swipe', 'One over the other, with a divider'], ['side', 'Side by side']] as const).map(([layout, words]) => (
          <label key={layout} class="choice">
            <input type="radio" name="layout" value={layout} checked={state.layout === layout} onChange={() => onChange({ layout })} />
            <span>{words}</span>
          </label>
        ))}
      </fieldset>
      <div class="row">
        <label class="inline">
          <input type="checkbox" checked={state.above} onChange={(event) => onAbove(event.currentTarget.checked)} /><span>From above</span>
        </label>
        <label class="inline">
          <input type="checkbox" checked={state.difference} onChange={(event) => onChange({ difference: event.currentTarget.checked })} />
          <span>Highlight differences</span>
        </label>
      </div>
    </>
  );
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
      <span>A point differs if the other version has none within</span>
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

/** The address changes without a new drawing of the page, so it is read when the button is about to be used. */
function ShareButton() {
  const [text, setText] = useState(window.location.href);
  return (
    <span onPointerEnter={() => setText(window.location.href)} onFocusCapture={() => setText(window.location.href)}>
      <CopyButton text={text} label="Copy a link to this view" />
    </span>
  );
}

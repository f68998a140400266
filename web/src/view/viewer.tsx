import { useEffect, useRef, useState } from 'preact/hooks';
import { readViewState } from '../scene/view_state.js';
import { theme } from '../ui/theme.js';
import type { MapFacts } from './facts.js';
import { LineLabels } from './line_labels.js';
import { ViewerModel } from './model.js';
import { ObjectCard } from './object_card.js';
import { Panel } from './panel.js';
import { ProfilePanel } from './profile_panel.js';
import { Readout } from './readout.js';
import { TopTools } from './top_tools.js';
import { Troubles } from './troubles.js';

const kSaid = 'Arrow keys turn it, Shift with arrow keys moves it, plus and minus zoom, 0 shows the whole map, T shows it from ' +
  'above. While measuring, Enter sets a point in the middle, Backspace removes the last point, Escape ends.';

/** One version in 3D, with its tools and panels. */
export function Viewer({ facts, query }: { facts: MapFacts; query: URLSearchParams }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [model, setModel] = useState<ViewerModel>();
  const [missing, setMissing] = useState(false);
  useEffect(() => {
    if (canvas.current === null) return undefined;
    let made: ViewerModel;
    try {
      made = new ViewerModel(canvas.current, facts, readViewState(query), theme.get());
    } catch {
      setMissing(true);
      return undefined;
    }
    setModel(made);
    const end = theme.listen((now) => made.setTheme(now));
    return () => {
      end();
      made.dispose();
    };
  }, [facts]);
  // An address that was typed or pasted. Changes by the view itself do not arrive here.
  const opened = useRef(query);
  useEffect(() => {
    if (query === opened.current) return;
    opened.current = query;
    model?.apply(readViewState(query));
  }, [query, model]);
  const onKey = (event: KeyboardEvent): void => {
    if (model === undefined || model.tools.name.get() === 'look') return;
    if (event.key === 'Enter') model.tools.placeInTheMiddle();
    if (event.key === 'Backspace') model.tools.undo();
  };
  return (
    <div class="viewer">
      <aside class="viewer-panel" aria-label="What is shown">{model !== undefined && <Panel model={model} />}</aside>
      <div class="viewer-stage">
        {missing && (
          <p class="viewer-message" role="alert">
            This browser cannot draw in 3D: WebGL 2 is missing or turned off. Turn on hardware acceleration in its
            settings, or use another browser.
          </p>
        )}
        <canvas
          ref={canvas} class="viewer-canvas" tabIndex={0} role="application" aria-roledescription="3D view"
          aria-label={`The map ${facts.name} in 3D. ${kSaid}`} onKeyDown={onKey}
        />
        {model !== undefined && (
          <>
            <LineLabels model={model} />
            <TopTools model={model} />
            <Troubles model={model} />
            <ObjectCard model={model} />
            <ProfilePanel model={model} />
            <Readout model={model} />
          </>
        )}
      </div>
    </div>
  );
}

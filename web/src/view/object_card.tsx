import { useState } from 'preact/hooks';
import { toApiError } from '../api/errors.js';
import { metres } from '../scene/measure.js';
import type { Decision } from '../scene/object_colours.js';
import { shownBox } from '../scene/objects_layer.js';
import { wayOf, type SeenObject } from '../scene/seen_objects.js';
import { number } from '../ui/format.js';
import { useStore } from '../state/store.js';
import { swatchOf } from './legend.js';
import type { ViewerModel } from './model.js';

const kDecisionWords: Record<Decision, string> = {
  keep: 'The next rebuild keeps it in the map.', remove: 'The next rebuild removes it, even if the detector does not find it.',
};

/** The object that was clicked, and the correction of it for the next rebuild. */
export function ObjectCard({ model }: { model: ViewerModel }) {
  const object = useStore(model.chosen);
  if (object === undefined) return null;
  return <Card key={object.number} model={model} object={object} />;
}

function Card({ model, object }: { model: ViewerModel; object: SeenObject }) {
  const decided = useStore(model.decisions).get(object.number);
  const [fault, setFault] = useState<string>();
  const [busy, setBusy] = useState(false);
  const { centre, size } = shownBox(object);
  const decide = async (decision: Decision | undefined): Promise<void> => {
    setBusy(true);
    try {
      await model.decide(object, decision);
      setFault(undefined);
    } catch (error) {
      setFault(toApiError(error).message);
    }
    setBusy(false);
  };
  const way = wayOf(object);
  return (
    <section class="viewer-card" aria-label="Selected object">
      <header>
        <h2>{swatchOf('class', object.class)} {object.class} {object.number}</h2>
        <button type="button" class="plain small" aria-label="Close" onClick={() => model.choose(undefined)}>×</button>
      </header>
      <dl class="facts">
        <dt>Motion</dt><dd>{object.motion}{way > 1 && `, over ${metres(way)}`}</dd>
        <dt>Score</dt><dd>{(100 * object.score).toFixed(0)} %</dd>
        <dt>Seen</dt><dd>scans {object.firstScan} to {object.lastScan}, {object.places.length > 1 ? `${object.places.length} positions` : 'one position'}</dd>
        <dt>Size</dt><dd>{size.map((length) => length.toFixed(1)).join(' × ')} m</dd>
        <dt>Centre</dt><dd>{centre.map((value) => value.toFixed(2)).join(', ')} m</dd>
        <dt>Removed</dt><dd>{number(object.pointsRemoved)} points</dd>
      </dl>
      <p class="quiet" role="status">{decided === undefined ? 'It was removed from this map.' : kDecisionWords[decided]}</p>
      {fault !== undefined && <p class="fault" role="alert">{fault}</p>}
      <div class="actions">
        <button type="button" class="small" disabled={busy} aria-pressed={decided === 'keep'} onClick={() => void decide('keep')}>Keep</button>
        <button type="button" class="small" disabled={busy} aria-pressed={decided === 'remove'} onClick={() => void decide('remove')}>Remove</button>
        {decided !== undefined && <button type="button" class="small plain" disabled={busy} onClick={() => void decide(undefined)}>Undo</button>}
        <button type="button" class="small plain" onClick={() => model.scene.lookAtPlace(centre, Math.hypot(...size))}>Move there</button>
      </div>
    </section>
  );
}

import { toGeodetic } from '../scene/geodetic.js';
import type { Pick } from '../scene/pointers.js';
import { plural } from '../ui/format.js';
import { useStore } from '../state/store.js';
import type { MapFacts } from './facts.js';
import type { ViewerModel } from './model.js';

/** The coordinates under the pointer. */
export function Readout({ model }: { model: ViewerModel }) {
  const pick = useStore(model.hover);
  const pending = useStore(model.stats)?.pending ?? 1;
  return (
    <div class="viewer-readout">
      {pick === undefined ? <span class="quiet">Point at the map to read coordinates</span> : <Place pick={pick} facts={model.facts} />}
      <span class="grow" />
      {pending > 0 && <span class="quiet">{plural(pending, 'tile')} loading</span>}
    </div>
  );
}

function Place({ pick, facts }: { pick: Pick; facts: MapFacts }) {
  const [x, y, z] = pick.position;
  const { point } = pick;
  return (
    <>
      <span class="place">x {x.toFixed(2)} · y {y.toFixed(2)} · z {z.toFixed(2)} m</span>
      {facts.geodetic_origin !== undefined && <Geodetic pick={pick} origin={facts.geodetic_origin} />}
      {point === undefined
        ? <span class="quiet">no point here: position on the ground plane</span>
        : <span class="quiet">{point.kind} · intensity {point.intensity.toFixed(2)} · seen {point.observations}×
            {point.level > 0 && ' · reduced detail'}</span>}
    </>
  );
}

function Geodetic({ pick, origin }: { pick: Pick; origin: NonNullable<MapFacts['geodetic_origin']> }) {
  const { latitude_deg, longitude_deg, altitude_m } = toGeodetic(pick.position, origin);
  return (
    <span class="place">
      {Math.abs(latitude_deg).toFixed(7)}° {latitude_deg >= 0 ? 'N' : 'S'} {Math.abs(longitude_deg).toFixed(7)}° {longitude_deg >= 0 ? 'E' : 'W'} {altitude_m.toFixed(2)} m
    </span>
  );
}

import { lookOf, type Vehicle, type Look } from './fleet.js';
import { lengthWords, reasonWords } from './words.js';
import { uncertaintyOf } from './uncertainty.js';
import { kSigmas } from './sigmas.js';

const kLookWords: Record<Look, string> = {
  ok: 'found', degraded: 'uncertain', lost: 'not found', stale: 'no new scans', new: 'no scan yet',
};

/** The vehicles that are tracked in this map. */
export function FleetPanel({ vehicles, chosen, onChoose }: {
  vehicles: readonly Vehicle[];
  chosen: string | null;
  onChoose: (label: string) => void;
}) {
  if (vehicles.length === 0) {
    return (
      <p class="quiet">
        No vehicle is tracked in this map. A vehicle opens a session with <code>POST /v1/sessions</code>. A key with the
        scope <code>admin</code> sees all sessions, any other key its own.
      </p>
    );
  }
  return (
    <ul class="fleet">
      {vehicles.map((vehicle) => {
        const look = lookOf(vehicle);
        return (
          <li key={vehicle.label}>
            <button
              type="button" class={`vehicle ${look}`} aria-pressed={vehicle.label === chosen}
              onClick={() => onChoose(vehicle.label)}
            >
              <span class={`verdict ${look}`}>{kLookWords[look]}</span>
              <strong>{vehicle.label}</strong>
              <span class="quiet">{detailOf(vehicle)}</span>
            </button>
          </li>
        );
      })}
    </ul>
  );
}

function detailOf(vehicle: Vehicle): string {
  const last = vehicle.scans === 0 ? 'none yet' : vehicle.idle_s < 1.5 ? 'just now' : `${Math.round(vehicle.idle_s)} s ago`;
  const sure = vehicle.pose !== null && vehicle.covariance !== null
    ? `, within ${lengthWords(kSigmas * uncertaintyOf(vehicle.pose, vehicle.covariance).major_m)}` : '';
  const why = vehicle.reasons.length > 0 ? ` – ${vehicle.reasons.map(reasonWords).join(' ')}` : '';
  return `${vehicle.scans} scans, last ${last}${sure}, version ${vehicle.version}${why}`;
}

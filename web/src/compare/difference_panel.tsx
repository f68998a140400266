import type { ApiError } from '../api/errors.js';
import { area } from '../ui/format.js';
import { Progress, Trouble } from '../ui/parts.js';
import { sideWords, type Difference, type Place } from './difference.js';

/** The difference: being computed, ready, or why it failed. */
export type DifferenceState =
  | { kind: 'making'; progress: number | null }
  | { kind: 'ready'; difference: Difference; places: Place[] }
  | { kind: 'failed'; error: ApiError };

interface Props {
  state: DifferenceState;
  a: string;
  b: string;
  chosen: number | null;
  onPlace: (index: number) => void;
  onRetry: () => void;
}

/** The differences between two versions: counts, and the places that changed most. */
export function DifferencePanel({ state, a, b, chosen, onPlace, onRetry }: Props) {
  if (state.kind === 'making') {
    return (
      <section class="difference" aria-label="Difference">
        <p role="status">Computing the differences{state.progress === null ? '…' : `: ${Math.round(100 * state.progress)} %`}</p>
        <Progress value={state.progress} label="Difference" />
      </section>
    );
  }
  if (state.kind === 'failed') {
    const frames = state.error.code === 'OtherFrame';
    return (
      <section class="difference" aria-label="Difference">
        <Trouble
          error={state.error} onRetry={frames ? undefined : onRetry}
          title={frames ? 'These versions cannot be compared' : 'The differences could not be computed'}
        />
        {frames && <p class="quiet">Both are shown in their own map frame, so the same position in the picture can be two places. Compare versions of one map frame instead.</p>}
      </section>
    );
  }
  const { difference, places } = state;
  return (
    <section class="difference" aria-label="Difference">
      <dl class="sides">
        <div class="only a"><dt><span class="swatch" /> Only in {a}</dt><dd>{sideWords(difference.only_in_other)}</dd></div>
        <div class="only b"><dt><span class="swatch" /> Only in {b}</dt><dd>{sideWords(difference.only_in_version)}</dd></div>
      </dl>
      <p class="quiet">A point is counted if the other version has none within {(100 * difference.tolerance_m).toFixed(0)} cm.</p>
      {places.length > 0 && <Places places={places} a={a} b={b} chosen={chosen} onPlace={onPlace} />}
    </section>
  );
}

function Places({ places, a, b, chosen, onPlace }: { places: Place[] } & Pick<Props, 'a' | 'b' | 'chosen' | 'onPlace'>) {
  const most = Math.max(...places.map((place) => place.onlyInVersion_m2 + place.onlyInOther_m2));
  return (
    <>
      <h2>Most changed places</h2>
      <ol class="places">
        {places.map((place, index) => (
          <li key={index}>
            <button type="button" class="place" aria-pressed={chosen === index} onClick={() => onPlace(index)}>
              <span class="place-number">{index + 1}</span>
              <span class="place-bar" aria-hidden="true">
                <span class="a" style={{ width: `${(100 * place.onlyInOther_m2) / most}%` }} />
                <span class="b" style={{ width: `${(100 * place.onlyInVersion_m2) / most}%` }} />
              </span>
              <span class="place-words">
                {area(place.onlyInOther_m2)} only in {a}, {area(place.onlyInVersion_m2)} only in {b}
              </span>
            </button>
          </li>
        ))}
      </ol>
    </>
  );
}

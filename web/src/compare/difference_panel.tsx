import type { ApiError } from '../api/errors.js';
import { area } from '../ui/format.js';
import { Progress, Trouble } from '../ui/parts.js';
import { sideWords, type Difference, type Place } from './difference.js';

/** How the difference stands: being worked out, there, or why not. */
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

/** What differs between two versions, counted, with the places that changed most. */
export function DifferencePanel({ state, a, b, chosen, onPlace, onRetry }: Props) {
  if (state.kind === 'making') {
    return (
      <section class="difference" aria-label="Difference">
        <p role="status">Working out what differs{state.progress === null ? '…' : `: ${Math.round(100 * state.progress)} %`}</p>
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
          title={frames ? 'These versions cannot be laid over each other' : 'The difference could not be worked out'}
        />
        {frames && <p class="quiet">They are shown as they are; the same place of the picture may be two places of the world.</p>}
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
      <p class="quiet">Counted: points with none of the other version within {(100 * difference.tolerance_m).toFixed(0)} cm.</p>
      {places.length > 0 && <Places places={places} a={a} b={b} chosen={chosen} onPlace={onPlace} />}
    </section>
  );
}

function Places({ places, a, b, chosen, onPlace }: { places: Place[] } & Pick<Props, 'a' | 'b' | 'chosen' | 'onPlace'>) {
  const most = Math.max(...places.map((place) => place.onlyInVersion_m2 + place.onlyInOther_m2));
  return (
    <>
      <h2>Changed most</h2>
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

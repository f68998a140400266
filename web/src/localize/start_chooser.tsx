import { useState } from 'preact/hooks';
import { Field } from '../ui/parts.js';
import { numberOf, readGnss, type GnssText } from './gnss_text.js';
import { headingOf, poseWithHeading, type Pose, type Vec3 } from './pose.js';
import type { Start } from './request.js';

export const kStartWords: Record<Start['kind'], string> = {
  everywhere: 'anywhere in the map', prior: 'from a place that I show', gnss: 'from a satellite fix',
};
const kKinds: readonly Start['kind'][] = ['everywhere', 'prior', 'gnss'];

interface Props {
  start: Start['kind'];
  onStart: (kind: Start['kind']) => void;
  prior: Pose | null;
  onPrior: (pose: Pose) => void;
  gnss: GnssText;
  onGnss: (text: GnssText) => void;
  /** Whether the map knows where on Earth it lies. */
  geodetic: boolean;
  /** Where the numbers of a prior begin when none was shown yet. */
  middle: Vec3;
}

/** Where the search for a pose begins. */
export function StartChooser(props: Props) {
  const fault = props.start === 'gnss' ? readGnss(props.gnss) : null;
  return (
    <fieldset class="start">
      <legend class="unseen">Where to look</legend>
      {kKinds.map((kind) => (
        <label key={kind} class="choice">
          <input
            type="radio" name="start" value={kind} checked={props.start === kind}
            disabled={kind === 'gnss' && !props.geodetic} onChange={() => props.onStart(kind)}
          />
          <span>{sentence(kStartWords[kind])}</span>
        </label>
      ))}
      {!props.geodetic && <p class="hint">This map does not know where on Earth it lies, so that a satellite fix says nothing.</p>}
      {props.start === 'prior' && <PriorNumbers {...props} />}
      {props.start === 'gnss' && (
        <div class="numbers">
          {([['latitude', 'Latitude [°]'], ['longitude', 'Longitude [°]'], ['altitude', 'Height [m]'], ['sigma', 'Deviation [m]']] as const)
            .map(([key, label]) => (
              <Field key={key} label={label}>
                {(given) => (
                  <input
                    {...given} inputMode="decimal" value={props.gnss[key]}
                    onInput={(event) => props.onGnss({ ...props.gnss, [key]: event.currentTarget.value })}
                  />
                )}
              </Field>
            ))}
          {typeof fault === 'string' && props.gnss.latitude !== '' && <p class="fault">{fault}</p>}
        </div>
      )}
    </fieldset>
  );
}

const sentence = (words: string): string => words.charAt(0).toUpperCase() + words.slice(1);

/** The same prior in numbers, for the keyboard and for places that are known. */
function PriorNumbers({ prior, onPrior, middle }: Props) {
  const shown = prior ?? poseWithHeading(middle, 0);
  const numbers = [...shown.position, (headingOf(shown) * 180) / Math.PI];
  const change = (index: number, value: number): void => {
    const next = numbers.map((before, i) => (i === index ? value : before));
    onPrior(poseWithHeading([next[0]!, next[1]!, next[2]!], (next[3]! * Math.PI) / 180));
  };
  return (
    <>
      <p class="hint">Press on the map where the sensor was and drag to where it looked. Or in numbers:</p>
      <div class="numbers">
        {['x [m]', 'y [m]', 'z [m]', 'Heading [°]'].map((label, index) => (
          <NumberField key={label} label={label} value={numbers[index]!} onChange={(value) => change(index, value)} />
        ))}
      </div>
    </>
  );
}

/** Keeps what is typed until it is a number. */
function NumberField({ label, value, onChange }: { label: string; value: number; onChange: (value: number) => void }) {
  const [typed, setTyped] = useState<string | null>(null);
  const wrong = typed !== null && !Number.isFinite(numberOf(typed));
  return (
    <Field label={label} fault={wrong ? 'A number.' : undefined}>
      {(given) => (
        <input
          {...given} inputMode="decimal" value={typed ?? value.toFixed(2)} onBlur={() => !wrong && setTyped(null)}
          onInput={(event) => {
            const text = event.currentTarget.value;
            setTyped(text);
            if (Number.isFinite(numberOf(text))) onChange(numberOf(text));
          }}
        />
      )}
    </Field>
  );
}

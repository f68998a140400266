import { useState } from 'preact/hooks';
import { Field } from '../ui/parts.js';
import { numberOf, readGnss, type GnssText } from './gnss_text.js';
import { headingOf, poseWithHeading, type Pose, type Vec3 } from './pose.js';
import type { Start } from './request.js';

export const kStartWords: Record<Start['kind'], string> = {
  everywhere: 'the whole map', prior: 'around a place on the map', gnss: 'around a GNSS position',
};
const kKinds: readonly Start['kind'][] = ['everywhere', 'prior', 'gnss'];

interface Props {
  start: Start['kind'];
  onStart: (kind: Start['kind']) => void;
  prior: Pose | null;
  onPrior: (pose: Pose) => void;
  gnss: GnssText;
  onGnss: (text: GnssText) => void;
  /** Whether the map has a position on Earth. */
  geodetic: boolean;
  /** First numbers of a prior, before the person shows one. */
  middle: Vec3;
}

/** Chooses where to search for the pose. */
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
      {!props.geodetic && <p class="hint">This map has no position on Earth, so it cannot be searched by GNSS.</p>}
      {props.start === 'prior' && <PriorNumbers {...props} />}
      {props.start === 'gnss' && (
        <div class="numbers">
          {([['latitude', 'Latitude [°]'], ['longitude', 'Longitude [°]'], ['altitude', 'Altitude [m]'], ['sigma', 'Standard deviation [m]']] as const)
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

/** The prior in numbers, for the keyboard and for known positions. */
function PriorNumbers({ prior, onPrior, middle }: Props) {
  const shown = prior ?? poseWithHeading(middle, 0);
  const numbers = [...shown.position, (headingOf(shown) * 180) / Math.PI];
  const change = (index: number, value: number): void => {
    const next = numbers.map((before, i) => (i === index ? value : before));
    onPrior(poseWithHeading([next[0]!, next[1]!, next[2]!], (next[3]! * Math.PI) / 180));
  };
  return (
    <>
      <p class="hint">Press on the map where the sensor was, and drag in the direction it faced. Or enter numbers:</p>
      <div class="numbers">
        {['x [m]', 'y [m]', 'z [m]', 'Heading [°]'].map((label, index) => (
          <NumberField key={label} label={label} value={numbers[index]!} onChange={(value) => change(index, value)} />
        ))}
      </div>
    </>
  );
}

/** Keeps the typed text until it is a number. */
function NumberField({ label, value, onChange }: { label: string; value: number; onChange: (value: number) => void }) {
  const [typed, setTyped] = useState<string | null>(null);
  const wrong = typed !== null && !Number.isFinite(numberOf(typed));
  return (
    <Field label={label} fault={wrong ? 'Enter a number.' : undefined}>
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

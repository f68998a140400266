import { Field } from '../ui/parts.js';
import type { RebuildChoices } from './rebuild_choices.js';

interface Choice {
  name: string;
  label: string;
  hint: string;
  /** The mapper's default first, said in words. */
  values: [string, string][];
}

const kChoices: Choice[] = [
  { name: 'detector', label: 'Objects found by', hint: 'What could move is found by it, parked or not.', values: [['', 'the usual detector'], ['voxelnext', 'the network (voxelnext)'], ['geometric', 'geometry alone']] },
  { name: 'movable', label: 'Points of objects', hint: 'What happens to points of what could move.', values: [['', 'go to the ground below'], ['delete', 'are dropped'], ['keep', 'stay']] },
  { name: 'clean', label: 'Cleaning', hint: 'Movers that no detector knows.', values: [['', 'by free space'], ['none', 'none'], ['removert', 'Removert'], ['erasor', 'ERASOR'], ['octomap', 'OctoMap'], ['dufomap', 'DUFOMap']] },
  { name: 'odometry', label: 'Poses', hint: 'Where the scans were taken.', values: [['', 'as it suits the drive'], ['loam', 'by LOAM'], ['given', 'as the drive gives them']] },
  { name: 'given-poses', label: 'Poses of the drive', hint: 'Neighbouring scans are registered, the frame stays; a survey needs none of it.', values: [['', 'refined'], ['exact', 'as they are']] },
  { name: 'fusion', label: 'Objects over time', hint: 'An object seen in many scans is taken out of all.', values: [['', 'fused'], ['off', 'each scan by itself']] },
  { name: 'fill', label: 'Ground below objects', hint: 'Filled where it was hidden, and marked so.', values: [['', 'filled'], ['off', 'left open']] },
  { name: 'loops', label: 'Loops', hint: 'Places that were passed twice are joined.', values: [['', 'closed'], ['off', 'left open']] },
  { name: 'preset', label: 'Preset', hint: 'All of it as in the paper, to compare with.', values: [['', 'usual'], ['paper', 'paper']] },
];

/** What of the mapper can be chosen; folded away, since the defaults are what nearly everybody wants. */
export function RebuildOptions({ choices, set }: { choices: RebuildChoices; set: (change: Partial<RebuildChoices>) => void }) {
  const option = (name: string, value: string): void => set({ options: { ...choices.options, [name]: value } });
  const changed = Object.values(choices.options).filter((value) => value !== '').length;
  return (
    <details class="card form-part" open={changed > 0}>
      <summary>Options {changed > 0 && <span class="quiet">{changed} changed</span>}</summary>
      <div class="option-grid">
        {kChoices.map(({ name, label, hint, values }) => (
          <Field key={name} label={label} hint={hint}>
            {(props) => (
              <select {...props} value={choices.options[name] ?? ''} onChange={(event) => option(name, event.currentTarget.value)}>
                {values.map(([value, words]) => <option key={value} value={value}>{words}</option>)}
              </select>
            )}
          </Field>
        ))}
        <Field label="Voxel [m]" hint="One point stays in each; 0.02 to 2.">
          {(props) => <input {...props} type="number" min="0.02" max="2" step="any" placeholder="usual" value={choices.options['voxel'] ?? ''} onInput={(event) => option('voxel', event.currentTarget.value)} />}
        </Field>
        <Field label="Height of the sensor [m]" hint="Above the ground; 0.1 to 10.">
          {(props) => <input {...props} type="number" min="0.1" max="10" step="any" placeholder="as the drive says" value={choices.options['sensor-height'] ?? ''} onInput={(event) => option('sensor-height', event.currentTarget.value)} />}
        </Field>
      </div>
    </details>
  );
}

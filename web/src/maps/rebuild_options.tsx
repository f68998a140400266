import { Field } from '../ui/parts.js';
import type { RebuildChoices } from './rebuild_choices.js';

interface Choice {
  name: string;
  label: string;
  hint: string;
  /** The mapper's default first. */
  values: [string, string][];
}

const kChoices: Choice[] = [
  { name: 'detector', label: 'Detector', hint: 'Finds objects that can move, parked ones too.', values: [['', 'default'], ['voxelnext', 'neural network (voxelnext)'], ['geometric', 'geometric']] },
  { name: 'movable', label: 'Points of movable objects', hint: 'What happens to the points of objects that can move.', values: [['', 'project to the ground'], ['delete', 'delete'], ['keep', 'keep']] },
  { name: 'clean', label: 'Cleaning', hint: 'Removes moving objects that the detector does not know.', values: [['', 'free space'], ['none', 'none'], ['removert', 'Removert'], ['erasor', 'ERASOR'], ['octomap', 'OctoMap'], ['dufomap', 'DUFOMap']] },
  { name: 'odometry', label: 'Odometry', hint: 'How the poses of the scans are found.', values: [['', 'automatic'], ['loam', 'LOAM'], ['given', 'poses of the drive']] },
  { name: 'given-poses', label: 'Poses of the drive', hint: 'Refining aligns neighbouring scans and keeps the map frame. Surveyed poses need no refining.', values: [['', 'refine'], ['exact', 'use as they are']] },
  { name: 'fusion', label: 'Objects over time', hint: 'Fusion removes an object from every scan that sees it.', values: [['', 'fuse'], ['off', 'each scan alone']] },
  { name: 'fill', label: 'Ground below objects', hint: 'Fills hidden ground. The filled points are marked.', values: [['', 'fill'], ['off', 'leave open']] },
  { name: 'loops', label: 'Loop closure', hint: 'Aligns places that were driven through twice.', values: [['', 'on'], ['off', 'off']] },
  { name: 'preset', label: 'Preset', hint: '“paper” sets all options as in the paper, for comparison.', values: [['', 'default'], ['paper', 'paper']] },
];

/** The mapper's options; folded away, since most people want the defaults. */
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
        <Field label="Voxel size [m]" hint="One point is kept in each voxel. 0.02 to 2.">
          {(props) => <input {...props} type="number" min="0.02" max="2" step="any" placeholder="default" value={choices.options['voxel'] ?? ''} onInput={(event) => option('voxel', event.currentTarget.value)} />}
        </Field>
        <Field label="Sensor height [m]" hint="Above the ground. 0.1 to 10.">
          {(props) => <input {...props} type="number" min="0.1" max="10" step="any" placeholder="from the drive" value={choices.options['sensor-height'] ?? ''} onInput={(event) => option('sensor-height', event.currentTarget.value)} />}
        </Field>
      </div>
    </details>
  );
}

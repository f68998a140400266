import { toApiError } from '../api/errors.js';
import type { Box, ClipMode } from '../scene/clip_box.js';
import type { Decision } from '../scene/object_colours.js';
import type { Vec3 } from '../scene/types.js';
import { say } from '../ui/notices.js';
import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';
import { Section } from './section.js';

const kAxes = ['East', 'North', 'Up'] as const;
const kSides = ['Length', 'Width', 'Height'] as const;

/** The clip box in numbers, and corrections for everything in it. */
export function ClipPanel({ model }: { model: ViewerModel }) {
  const { clip } = useStore(model.options);
  if (clip === undefined) return null;
  const set = (box: Partial<Box>): void => model.change({ clip: { ...clip, box: { ...clip.box, ...box } } });
  const decide = (action: Decision): void => {
    model.decideRegion(clip.box, action).then(
      () => say({ kind: 'good', text: `Saved: the next rebuild will ${action} everything in the box.` }),
      (error: unknown) => say({ kind: 'bad', text: toApiError(error).message }));
  };
  return (
    <Section title="Clip box">
      <p class="quiet">Drag the handles in the picture: those on the sides resize the box, the one in the middle moves it.</p>
      <div class="viewer-numbers">
        {kAxes.map((name, axis) => (
          <Coordinate key={name} name={name} value={clip.box.centre[axis] as number} step={0.5}
            onChange={(value) => set({ centre: replaced(clip.box.centre, axis, value) })} />
        ))}
        {kSides.map((name, axis) => (
          <Coordinate key={name} name={name} value={clip.box.size[axis] as number} step={0.5} min={0.1}
            onChange={(value) => value > 0 && set({ size: replaced(clip.box.size, axis, value) })} />
        ))}
        <Coordinate name="Yaw °" value={(clip.box.yaw * 180) / Math.PI} step={5}
          onChange={(value) => set({ yaw: (value * Math.PI) / 180 })} />
        <label class="viewer-number">
          <span>Show</span>
          <select value={clip.mode} onChange={({ currentTarget }) =>
            model.change({ clip: { ...clip, mode: currentTarget.value as ClipMode } })}>
            <option value="inside">inside</option><option value="outside">outside</option>
          </select>
        </label>
      </div>
      <div class="actions">
        <button type="button" class="small" onClick={() => model.change({ clip: undefined })}>Close the box</button>
        <button type="button" class="small" title="The next rebuild keeps everything in the box" onClick={() => decide('keep')}>
          Keep contents</button>
        <button type="button" class="small" title="The next rebuild removes everything in the box" onClick={() => decide('remove')}>
          Remove contents</button>
      </div>
    </Section>
  );
}

function Coordinate(
  { name, value, step, min, onChange }: {
    name: string; value: number; step: number; min?: number; onChange: (value: number) => void;
  },
) {
  return (
    <label class="viewer-number">
      <span>{name}</span>
      <input
        type="number" step={step} {...(min !== undefined && { min })} value={Number(value.toFixed(2))}
        onChange={({ currentTarget }) => Number.isFinite(currentTarget.valueAsNumber) && onChange(currentTarget.valueAsNumber)}
      />
    </label>
  );
}

function replaced(values: Vec3, axis: number, value: number): Vec3 {
  return values.map((old, i) => (i === axis ? value : old)) as unknown as Vec3;
}

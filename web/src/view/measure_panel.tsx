import { between, metres, total } from '../scene/measure.js';
import { lengthOf } from '../scene/section.js';
import type { Vec3 } from '../scene/types.js';
import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';
import { Section } from './section.js';

/** The measured lengths. */
export function MeasurePanel({ model }: { model: ViewerModel }) {
  const line = useStore(model.tools.line);
  const section = useStore(model.tools.section);
  if (line.length === 0 && section === undefined) return null;
  const sum = total(line);
  return (
    <Section title="Measurement">
      {line.length > 1 && (
        <table class="viewer-measures">
          <thead><tr><th>Segment</th><th class="end">Length</th><th class="end">Horizontal</th><th class="end">Rise</th></tr></thead>
          <tbody>
            {line.slice(1).map((place, i) => {
              const leg = between(line[i] as Vec3, place);
              return <Row key={i} name={String(i + 1)} {...leg} />;
            })}
            {line.length > 2 && <Row name="Total" {...sum} />}
          </tbody>
        </table>
      )}
      {line.length === 1 && <p class="quiet">One point is set. Click the next one.</p>}
      {section !== undefined && (
        <div class="viewer-row">
          <span>Section {metres(lengthOf(section))} long and</span>
          <input
            type="number" aria-label="Thickness of the section in metres" min={0.1} max={50} step={0.1} value={section.width}
            onChange={({ currentTarget }) => model.tools.setSectionWidth(currentTarget.valueAsNumber)}
          />
          <span>m thick</span>
        </div>
      )}
      <button type="button" class="small" onClick={() => model.tools.clear()}>Clear</button>
    </Section>
  );
}

function Row({ name, straight, horizontal, rise }: { name: string; straight: number; horizontal: number; rise: number }) {
  return (
    <tr>
      <th scope="row">{name}</th>
      <td class="end">{metres(straight)}</td><td class="end">{metres(horizontal)}</td>
      <td class="end">{rise >= 0 ? '+' : '−'}{metres(Math.abs(rise))}</td>
    </tr>
  );
}

import { useState } from 'preact/hooks';
import { kExportFormats, type ExportFormat } from '../scene/export_points.js';
import { plural } from '../ui/format.js';
import { say } from '../ui/notices.js';
import { saveBlob } from '../ui/save.js';
import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';
import { Section } from './section.js';
import type { ExportScope } from './tools.js';

const kScopeWords: Record<ExportScope, string> = { map: 'Whole map', clip: 'Clip box', section: 'Section' };

/** Saves points in full resolution to a file. */
export function ExportPanel({ model }: { model: ViewerModel }) {
  const { clip } = useStore(model.options);
  const section = useStore(model.tools.section);
  const work = useStore(model.tools.work);
  const [wanted, setWanted] = useState<ExportScope>();
  const [format, setFormat] = useState<ExportFormat>('ply');
  const scopes: ExportScope[] = ['map', ...(clip === undefined ? [] : ['clip' as const]), ...(section === undefined ? [] : ['section' as const])];
  const scope = wanted !== undefined && scopes.includes(wanted) ? wanted : scopes[scopes.length - 1] as ExportScope;
  const save = async (): Promise<void> => {
    const file = await model.tools.export(scope, format);
    if (file === undefined) return;
    saveBlob(file.blob, `${model.facts.name}-${model.facts.version}-${scope}.${format}`);
    say({ kind: 'good', text: `Saved ${plural(file.points, 'point')} of the kinds that are shown.` });
  };
  return (
    <Section title="Export">
      <div class="viewer-row viewer-export">
        <select aria-label="What to export" value={scope} onChange={({ currentTarget }) => setWanted(currentTarget.value as ExportScope)}>
          {scopes.map((name) => <option key={name} value={name}>{kScopeWords[name]}</option>)}
        </select>
        <select aria-label="File format" value={format} onChange={({ currentTarget }) => setFormat(currentTarget.value as ExportFormat)}>
          {kExportFormats.map((name) => <option key={name} value={name}>{name.toUpperCase()}</option>)}
        </select>
        <button type="button" class="small" disabled={work.state === 'busy'} onClick={() => void save()}>Save</button>
      </div>
    </Section>
  );
}

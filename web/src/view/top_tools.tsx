import { say } from '../ui/notices.js';
import { Progress } from '../ui/parts.js';
import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';
import type { ToolName } from './tools.js';

const kTools: readonly { name: ToolName; text: string; hint: string }[] = [
  { name: 'look', text: 'Look', hint: 'Drag to rotate. Click a box to see its object.' },
  { name: 'measure', text: 'Measure', hint: 'Click one point after the other. Backspace removes the last one, Escape ends.' },
  { name: 'section', text: 'Section', hint: 'Click the two ends of a vertical section.' },
  { name: 'clip', text: 'Clip', hint: 'Click two opposite corners of the part to show.' },
];

/** The tools above the picture: pointer, view and link. */
export function TopTools({ model }: { model: ViewerModel }) {
  const name = useStore(model.tools.name);
  const work = useStore(model.tools.work);
  const share = async (): Promise<void> => {
    const copied = await navigator.clipboard.writeText(window.location.href).then(() => true, () => false);
    say(copied ? { kind: 'good', text: 'Copied a link to this view.' }
      : { kind: 'plain', text: 'The browser does not allow copying. Copy the link from the address bar.' });
  };
  const hint = kTools.find((tool) => tool.name === name)?.hint ?? '';
  return (
    <div class="viewer-top">
      <div class="segments" role="radiogroup" aria-label="Pointer">
        {kTools.map((tool) => (
          <button
            key={tool.name} type="button" role="radio" aria-checked={tool.name === name} title={tool.hint}
            onClick={() => model.tools.use(tool.name)}
          >{tool.text}</button>
        ))}
      </div>
      <div class="segments">
        <button type="button" onClick={() => model.scene.showAll()}>Whole map</button>
        <button type="button" onClick={() => model.scene.showFromAbove()}>From above</button>
        <button type="button" onClick={() => void share()}>Copy link</button>
      </div>
      {work.state === 'busy' && (
        <div class="viewer-hint viewer-work"><Progress value={work.share} label="Loading points in full resolution" /></div>
      )}
      {name !== 'look' && <p class="viewer-hint" role="status">{hint}</p>}
    </div>
  );
}

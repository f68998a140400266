import { say } from '../ui/notices.js';
import { Progress } from '../ui/parts.js';
import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';
import type { ToolName } from './tools.js';

const kTools: readonly { name: ToolName; text: string; hint: string }[] = [
  { name: 'look', text: 'Look', hint: 'Drag turns the picture; a click on a box tells about it.' },
  { name: 'measure', text: 'Measure', hint: 'Click places one after the other. Backspace takes one back, Escape ends.' },
  { name: 'section', text: 'Section', hint: 'Click the two ends of a vertical cut.' },
  { name: 'clip', text: 'Clip', hint: 'Click two opposite corners of the part to keep.' },
];

/** Above the picture: what the pointer does, and where to look from. */
export function TopTools({ model }: { model: ViewerModel }) {
  const name = useStore(model.tools.name);
  const work = useStore(model.tools.work);
  const share = async (): Promise<void> => {
    const copied = await navigator.clipboard.writeText(window.location.href).then(() => true, () => false);
    say(copied ? { kind: 'good', text: 'The address of this view is copied.' }
      : { kind: 'plain', text: 'This view has the address in the browser’s address line.' });
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
        <button type="button" onClick={() => void share()}>Share</button>
      </div>
      {work.state === 'busy' && (
        <div class="viewer-hint viewer-work"><Progress value={work.share} label="Fetching points of full resolution" /></div>
      )}
      {name !== 'look' && <p class="viewer-hint" role="status">{hint}</p>}
    </div>
  );
}

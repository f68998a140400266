import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';

/** Errors while the map is shown; the picture stays. */
export function Troubles({ model }: { model: ViewerModel }) {
  const trouble = useStore(model.trouble);
  const fault = useStore(model.fault);
  const lost = useStore(model.contextLost);
  const work = useStore(model.tools.work);
  const lines = [
    trouble?.text,
    fault === undefined ? undefined : `Boxes and trajectory could not be loaded. ${fault}`,
    lost ? 'The browser lost the graphics context. If the picture does not come back, reload the page.' : undefined,
    work.state === 'failed' ? work.text : undefined,
  ].filter((line) => line !== undefined);
  if (lines.length === 0) return null;
  return (
    <div class="viewer-message" role="alert">
      {lines.map((line) => <p key={line}>{line}</p>)}
      <button type="button" class="small" onClick={() => model.retry()}>Try again</button>
    </div>
  );
}

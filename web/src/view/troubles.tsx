import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';

/** What went wrong while the map is shown, in words; the picture stays. */
export function Troubles({ model }: { model: ViewerModel }) {
  const trouble = useStore(model.trouble);
  const fault = useStore(model.fault);
  const lost = useStore(model.contextLost);
  const work = useStore(model.tools.work);
  const lines = [
    trouble?.text,
    fault === undefined ? undefined : `Boxes and trajectory are missing. ${fault}`,
    lost ? 'The graphics card gave up the picture. It comes back by itself; if not, reload the page.' : undefined,
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

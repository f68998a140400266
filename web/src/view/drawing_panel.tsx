import type { Quality } from '../scene/scene.js';
import { bytes, short } from '../ui/format.js';
import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';
import { kBudgets } from './options.js';

const kQualityWords: Record<Quality, string> = { auto: 'automatic', full: 'full', reduced: 'reduced' };

/** How much is drawn, and the load. */
export function DrawingPanel({ model }: { model: ViewerModel }) {
  const { budget, eyeDome, quality } = useStore(model.options);
  const stats = useStore(model.stats);
  return (
    <details class="viewer-help">
      <summary>Drawing</summary>
      <div class="viewer-numbers">
        <label class="viewer-number wide">
          <span>Point budget</span>
          <select value={budget} onChange={({ currentTarget }) => model.change({ budget: Number(currentTarget.value) })}>
            {kBudgets.map((points) => <option key={points} value={points}>{short(points)}</option>)}
          </select>
        </label>
        <label class="viewer-number wide">
          <span>Quality</span>
          <select value={quality} onChange={({ currentTarget }) => model.change({ quality: currentTarget.value as Quality })}>
            {Object.entries(kQualityWords).map(([name, words]) => <option key={name} value={name}>{words}</option>)}
          </select>
        </label>
        <label class="viewer-check">
          <input type="checkbox" name="eye-dome" checked={eyeDome}
            onChange={({ currentTarget }) => model.change({ eyeDome: currentTarget.checked })} />
          <span>Shade edges (eye-dome lighting)</span>
        </label>
      </div>
      {stats !== undefined && (
        <dl class="viewer-stats">
          <div><dt>Points shown</dt><dd data-stat="points" data-value={stats.points}>{short(stats.points)}</dd></div>
          <div><dt>Tiles shown</dt><dd data-stat="tiles" data-value={stats.tiles}>{stats.tiles}</dd></div>
          <div><dt>Tiles loading</dt><dd data-stat="pending" data-value={stats.pending}>{stats.pending}</dd></div>
          <div><dt>Tiles in memory</dt><dd data-stat="bytes" data-value={stats.bytes}>{bytes(stats.bytes)}</dd></div>
          <div><dt>Script per frame</dt><dd data-stat="script" data-value={stats.scriptMs}>{stats.scriptMs.toFixed(1)} ms</dd></div>
          <div><dt>Frames drawn</dt><dd data-stat="frames" data-value={stats.frames}>{stats.frames}</dd></div>
        </dl>
      )}
    </details>
  );
}

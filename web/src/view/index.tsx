import { useCallback } from 'preact/hooks';
import { Trouble } from '../ui/parts.js';
import { useLoad } from '../ui/load.js';
import type { ViewProps } from '../state/router.js';
import { loadFacts } from './facts.js';
import { Viewer } from './viewer.js';
import './view.css';

/** A version of a map in 3D: `#/view/MAP/VERSION`, or the active one of `#/view/MAP`. */
export default function MapView({ path, query }: ViewProps) {
  const [map = '', version] = path;
  const load = useCallback((signal: AbortSignal) => loadFacts(map, version, signal), [map, version]);
  const { data: facts, error, reload } = useLoad(load, [map, version]);
  if (facts !== undefined) return <Viewer key={`${facts.name} ${facts.version}`} facts={facts} query={query} />;
  if (error === undefined) return <p class="waiting" role="status">Loading the map…</p>;
  return (
    <div class="page">
      <Trouble error={error} title={`The map “${map}” cannot be shown`} onRetry={reload} />
      <p><a href="#/maps">All maps</a></p>
    </div>
  );
}

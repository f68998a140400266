import './compare.css';
import { useState } from 'preact/hooks';
import { toApiError, type ApiError } from '../api/errors.js';
import { linkTo } from '../state/router.js';
import { useLoad } from '../ui/load.js';
import { Empty, Trouble } from '../ui/parts.js';
import type { ViewProps } from '../state/router.js';
import { Comparison } from './comparison.js';
import { aboutVersion, versionNames, type Version } from './routes.js';

interface Loaded {
  names: string[];
  a: Version | ApiError;
  b: Version | ApiError;
}

/** Two versions of a map beside each other: `#/compare/MAP/A/B`. */
export default function CompareView({ path, query }: ViewProps) {
  const [map = '', a = '', b = ''] = path;
  const { data, error, reload } = useLoad((signal) => load(map, a, b, signal), [map, a, b]);
  // The view writes the query itself; a new pair starts with the query of its address.
  const [begin] = useState(query);
  if (error !== undefined && data === undefined) {
    return <div class="page"><Trouble error={error} onRetry={reload} title={`The versions of ${map} cannot be shown`} /></div>;
  }
  if (data === undefined) return <p class="waiting" role="status">Loading both versions…</p>;
  const gone = [data.a, data.b].find((version) => !('origin' in version)) as ApiError | undefined;
  if (gone !== undefined) return <Gone map={map} asked={[a, b]} names={data.names} error={gone} />;
  return <Comparison key={`${map}/${a}/${b}`} map={map} a={data.a as Version} b={data.b as Version} names={data.names} query={begin} />;
}

async function load(map: string, a: string, b: string, signal: AbortSignal): Promise<Loaded> {
  const names = await versionNames(map, signal);
  const about = (name: string): Promise<Version | ApiError> => aboutVersion(map, name, signal).catch((error: unknown) => {
    signal.throwIfAborted();
    const known = toApiError(error);
    if (known.status !== 404) throw known;
    return known;
  });
  const [first, second] = await Promise.all([about(a), about(b)]);
  return { names, a: first, b: second };
}

/** Says that one of the two versions does not exist, and offers others. */
function Gone({ map, asked, names, error }: { map: string; asked: string[]; names: string[]; error: ApiError }) {
  const missing = asked.filter((name) => !names.includes(name));
  const newest = names.slice(-2);
  return (
    <div class="page">
      <Empty title={missing.length === 0 ? 'A version cannot be loaded' : `${map} has no version ${missing.map((name) => `“${name}”`).join(' or ')}`}>
        <p>{error.message}</p>
        {newest.length === 2 && (
          <p><a href={linkTo('compare', [map, newest[0]!, newest[1]!])}>Compare {newest[0]} with {newest[1]}</a></p>
        )}
        <p><a href={linkTo('maps', [map])}>Versions of {map}</a></p>
      </Empty>
    </div>
  );
}

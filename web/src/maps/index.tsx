import { ask } from '../api/client.js';
import { linkTo } from '../router.js';
import { useLoad } from '../ui/load.js';
import { Trouble } from '../ui/parts.js';
import type { ViewProps } from '../views.js';

export default function MapsView(_: ViewProps) {
  const { data, error, reload } = useLoad((signal) => ask('get', '/v1/maps', { signal }), [], { everyS: 5 });
  return (
    <>
      <h1>Maps</h1>
      {error !== undefined && <Trouble error={error} onRetry={reload} />}
      <ul>{data?.data.maps.map((map) => <li key={map.name}><a href={linkTo('view', [map.name])}>{map.name}</a></li>)}</ul>
    </>
  );
}

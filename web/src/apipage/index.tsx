import './api.css';
import { useMemo } from 'preact/hooks';
import { jsonOf, send } from '../api/send.js';
import { linkTo, rewriteAddress, type ViewProps } from '../state/router.js';
import { useLoad } from '../ui/load.js';
import { Trouble } from '../ui/parts.js';
import { tagOf, type Contract } from './contract.js';
import { Swagger } from './swagger.js';

/** The server's API, from the document that it serves itself. `#/api/route/NAME` shows one operation. */
export default function ApiView({ path: [what, id] }: ViewProps) {
  const { data: contract, error, reload } = useLoad(async (signal) =>
    (await jsonOf(await send('GET', '/openapi.json', { signal }), 'GET /openapi.json')) as Contract, []);
  const shown = useMemo(() => {
    const tag = contract === undefined || what !== 'route' || id === undefined ? undefined : tagOf(contract, id);
    return tag === undefined || id === undefined ? undefined : { tag, id };
  }, [contract, what, id]);
  return (
    <>
      <div class="heading">
        <h1>API</h1>
        <span class="grow" />
        <a class="button" href="/openapi.json" download="openapi.json">Download openapi.json</a>
      </div>
      {contract !== undefined && (
        <Swagger contract={contract} shown={shown} onOpen={(opened) => rewriteAddress(linkTo('api', ['route', opened]))} />
      )}
      {contract === undefined && (error === undefined
        ? <p class="waiting" role="status">Loading the description of the API…</p> : <Trouble error={error} onRetry={reload} />)}
    </>
  );
}

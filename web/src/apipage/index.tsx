import './api.css';
import { useEffect, useMemo, useState } from 'preact/hooks';
import { jsonOf, send } from '../api/send.js';
import { linkTo } from '../state/router.js';
import { plural } from '../ui/format.js';
import { useLoad } from '../ui/load.js';
import { Trouble } from '../ui/parts.js';
import type { ViewProps } from '../state/router.js';
import { routesByTag, type ApiDocument, type Route } from './document.js';
import { RouteCard } from './route_card.js';
import { SchemaCard } from './schema_card.js';
import { Verb } from './verb.js';

/** The server's routes, from the document that it serves itself. */
export default function ApiView({ path: [what, name] }: ViewProps) {
  const { data: document, error, reload } = useLoad(async (signal) =>
    (await jsonOf(await send('GET', '/openapi.json', { signal }), 'GET /openapi.json')) as ApiDocument, []);
  const [filter, setFilter] = useState('');
  const tags = useMemo(() => (document === undefined ? [] : routesByTag(document)), [document]);
  useEffect(() => {
    if (document === undefined || name === undefined) return;
    window.document.getElementById(`${what}-${name}`)?.scrollIntoView({ block: 'start' });
  }, [document, what, name]);
  if (document === undefined) {
    return error === undefined ? <p class="waiting" role="status">Asking the server for its document…</p> : <Trouble error={error} onRetry={reload} />;
  }
  const matches = ({ method, path, operation }: Route): boolean =>
    `${method} ${path} ${operation.summary ?? ''}`.toLowerCase().includes(filter.trim().toLowerCase());
  const shown = tags.map((tag) => ({ ...tag, routes: tag.routes.filter(matches) })).filter(({ routes }) => routes.length > 0);
  return (
    <div class="api">
      <nav class="api-nav" aria-label="Routes">
        <input
          type="search" placeholder="Filter routes" aria-label="Filter routes" value={filter}
          onInput={(event) => setFilter(event.currentTarget.value)}
        />
        {shown.map((tag) => (
          <div key={tag.name}>
            <h3>{tag.name}</h3>
            <ul>
              {tag.routes.map((route) => (
                <li key={route.id}>
                  <a href={linkTo('api', ['route', route.id])} aria-current={what === 'route' && name === route.id ? 'true' : undefined}>
                    <Verb method={route.method} /> {route.operation.summary}
                  </a>
                </li>
              ))}
            </ul>
          </div>
        ))}
      </nav>
      <div class="api-main">
        <div class="heading">
          <h1>API</h1>
          <span class="quiet">{plural(tags.reduce((sum, { routes }) => sum + routes.length, 0), 'route')}</span>
          <span class="grow" />
          <a class="button" href="/openapi.json">openapi.json</a>
        </div>
        <p class="about">{document.info?.description}</p>
        {shown.length === 0 && <p class="quiet">No route has these words.</p>}
        {shown.map((tag) => (
          <section key={tag.name} aria-labelledby={`tag-${tag.name}`}>
            <h2 id={`tag-${tag.name}`}>{tag.name} <span class="quiet">{tag.description}</span></h2>
            {tag.routes.map((route) => (
              <RouteCard key={route.id} document={document} route={route} open={what === 'route' && name === route.id} />
            ))}
          </section>
        ))}
        {filter === '' && (
          <section aria-labelledby="schemas">
            <h2 id="schemas">Schemas</h2>
            {Object.keys(document.components?.['schemas'] ?? {}).map((schema) => (
              <SchemaCard key={schema} document={document} name={schema} open={what === 'schema' && name === schema} />
            ))}
          </section>
        )}
      </div>
    </div>
  );
}

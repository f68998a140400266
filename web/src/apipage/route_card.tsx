import { useEffect, useState } from 'preact/hooks';
import { CopyButton } from '../ui/parts.js';
import { curlOf, scopeOf } from './curl.js';
import { nameOfRef, resolve, type ApiDocument, type ApiResponse, type Parameter, type Route } from './document.js';
import { Properties, Type } from './schema_card.js';
import { TryIt } from './try_it.js';
import { Verb } from './verb.js';

export interface RouteCardProps {
  document: ApiDocument;
  route: Route;
  open: boolean;
}

/** One route: what it takes, what it answers, and a line that asks it. */
export function RouteCard({ document, route, open }: RouteCardProps) {
  const [shown, setShown] = useState(open);
  useEffect(() => {
    if (open) setShown(true);
  }, [open]);
  return (
    <details class="card route" id={`route-${route.id}`} open={shown} onToggle={(event) => setShown(event.currentTarget.open)}>
      <summary>
        <Verb method={route.method} /> <code>{route.path}</code> <span class="quiet">{route.operation.summary}</span>
      </summary>
      {shown && <Body document={document} route={route} />}
    </details>
  );
}

function Body({ document, route }: { document: ApiDocument; route: Route }) {
  const { operation } = route;
  const parameters = (operation.parameters ?? []).map((one) => resolve<Parameter>(document, one)).filter((one) => one !== undefined);
  const scope = scopeOf(route);
  const curl = curlOf(document, route, window.location.origin);
  return (
    <div class="route-body">
      {operation.description !== undefined && <p>{operation.description}</p>}
      <p class="quiet">{scope === undefined ? 'Open: needs no key.' : `A key needs the scope “${scope}”.`}</p>
      {parameters.length > 0 && <Parameters parameters={parameters} />}
      {operation.requestBody?.content !== undefined && <RequestBody document={document} content={operation.requestBody.content} />}
      <Responses document={document} responses={operation.responses ?? {}} />
      <div class="heading"><h4>With curl</h4><span class="grow" /><CopyButton text={curl} label="Copy" /></div>
      <pre tabIndex={0} class="example curl">{curl}</pre>
      {route.method === 'GET' && <TryIt route={route} parameters={parameters} />}
    </div>
  );
}

function Parameters({ parameters }: { parameters: readonly Parameter[] }) {
  return (
    <>
      <h4>Parameters</h4>
      <ul class="properties">
        {parameters.map((parameter) => (
          <li key={`${parameter.in}.${parameter.name}`}>
            <code>{parameter.name}</code>{parameter.required === true && <span class="required" title="required">*</span>}{' '}
            <span class="type">{parameter.in}</span> <Type schema={parameter.schema} /> <span class="words">{parameter.description}</span>
          </li>
        ))}
      </ul>
    </>
  );
}

function RequestBody({ document, content }: { document: ApiDocument; content: Record<string, { schema?: import('./document.js').Schema }> }) {
  return (
    <>
      <h4>Body</h4>
      <ul class="properties">
        {Object.entries(content).map(([type, { schema }]) => (
          <li key={type}>
            <code>{type}</code> <Type schema={schema} /> <span class="words">{schema?.description}</span>
            {schema !== undefined && <Properties schema={resolve(document, schema) ?? schema} />}
          </li>
        ))}
      </ul>
    </>
  );
}

function Responses({ document, responses }: { document: ApiDocument; responses: Record<string, ApiResponse | { $ref: string }> }) {
  return (
    <>
      <h4>Answers</h4>
      <ul class="properties">
        {Object.entries(responses).map(([status, response]) => {
          const known = resolve<ApiResponse>(document, response);
          const [type, content] = Object.entries(known?.content ?? {})[0] ?? [];
          const words = '$ref' in response && known?.description === undefined ? nameOfRef(response.$ref) : known?.description;
          return (
            <li key={status}>
              <code class={/^[23]/.test(status) ? 'status good' : 'status'}>{status}</code> <span class="words">{words?.replace(/`/g, '')}</span>
              {/^2/.test(status) && content !== undefined && <> {type !== 'application/json' && <code>{type}</code>} <Type schema={content.schema} /></>}
            </li>
          );
        })}
      </ul>
    </>
  );
}

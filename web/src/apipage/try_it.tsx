import { useState } from 'preact/hooks';
import { addressOf } from '../api/client.js';
import { isAborted, toApiError, type ApiError } from '../api/errors.js';
import { send } from '../api/send.js';
import { bytes } from '../ui/format.js';
import { useKept } from '../ui/kept.js';
import { Field, Trouble } from '../ui/parts.js';
import type { Parameter, Route } from './document.js';

const kMostShown = 20_000;

/** Asks a route that changes nothing, with what is typed, and shows the answer as it came. */
export function TryIt({ route, parameters }: { route: Route; parameters: readonly Parameter[] }) {
  // The same names mean the same thing in all routes: a map is typed once.
  const [values, setValues] = useKept<Record<string, string>>('api.values', {});
  const [answer, setAnswer] = useState<{ head: string; text: string }>();
  const [error, setError] = useState<ApiError>();
  const asked = parameters.filter((one) => one.in === 'path' || one.in === 'query');
  const missing = asked.filter((one) => one.in === 'path' && (values[one.name] ?? '') === '').map(({ name }) => name);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    setError(undefined);
    setAnswer(undefined);
    const query = Object.fromEntries(asked.filter((one) => one.in === 'query').map(({ name }) => [name, values[name]]));
    try {
      const path = addressOf(route.path, values, query);
      const response = await send('GET', path, { patience: 0 });
      setAnswer({ head: `GET ${path}: ${response.status}`, text: await textOf(response) });
    } catch (reason) {
      if (!isAborted(reason)) setError(toApiError(reason));
    }
  };
  if (/\/events$/.test(route.path)) return null;
  return (
    <form class="try" onSubmit={(event) => void submit(event)}>
      <h4>Try it</h4>
      {asked.length > 0 && (
        <div class="option-grid">
          {asked.map(({ name, required }) => (
            <Field key={name} label={required === true ? name : `${name} (if wanted)`}>
              {(props) => <input {...props} value={values[name] ?? ''} onInput={(event) => setValues({ ...values, [name]: event.currentTarget.value })} />}
            </Field>
          ))}
        </div>
      )}
      <div class="actions"><button type="submit" disabled={missing.length > 0}>Ask the server</button>
        {missing.length > 0 && <span class="quiet">Fill in {missing.join(', ')}.</span>}</div>
      {error !== undefined && <Trouble error={error} />}
      {answer !== undefined && <><p class="quiet" role="status">{answer.head}</p><pre tabIndex={0} class="example">{answer.text}</pre></>}
    </form>
  );
}

async function textOf(response: Response): Promise<string> {
  const type = response.headers.get('content-type') ?? '';
  if (!/json|text/.test(type)) {
    const size = (await response.arrayBuffer()).byteLength;
    return `${type}, ${bytes(size)}`;
  }
  const text = await response.text();
  const shown = type.includes('json') ? JSON.stringify(JSON.parse(text), null, 2) : text;
  return shown.length > kMostShown ? `${shown.slice(0, kMostShown)}\n… ${bytes(text.length)} in all` : shown;
}

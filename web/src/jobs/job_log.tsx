import { useEffect, useRef, useState } from 'preact/hooks';
import { ApiError, isAborted, toApiError } from '../api/errors.js';
import { send, sleep } from '../api/send.js';
import { Trouble } from '../ui/parts.js';

const kEveryS = 1.5;

/** The mapper's log, read again as it grows. */
export function JobLog({ id, over }: { id: number; over: boolean }) {
  const [text, setText] = useState('');
  const [error, setError] = useState<ApiError>();
  const [stays, setStays] = useState(true);
  const [turn, setTurn] = useState(0);
  const pre = useRef<HTMLPreElement>(null);
  useEffect(() => {
    const stop = new AbortController();
    setError(undefined);
    readOn(id, over, setText, stop.signal).catch((reason: unknown) => isAborted(reason) || setError(toApiError(reason)));
    return () => stop.abort();
  }, [id, over, turn]);
  useEffect(() => {
    if (stays && pre.current !== null) pre.current.scrollTop = pre.current.scrollHeight;
  }, [text, stays]);
  return (
    <section aria-labelledby="log">
      <div class="heading">
        <h2 id="log">Log</h2>
        <span class="grow" />
        <label class="check">
          <input type="checkbox" checked={stays} onChange={(event) => setStays(event.currentTarget.checked)} /> Follow the end
        </label>
      </div>
      {error !== undefined && (error.status === 403
        ? <p class="quiet">The log contains file names of the server. Use a key with the scope “write” to read it.</p>
        : <Trouble error={error} onRetry={() => setTurn(turn + 1)} />)}
      <pre ref={pre} class="card log" tabIndex={0} aria-label="Log of the job">{text === '' ? (over ? 'The log is empty.' : 'No log lines yet.') : text}</pre>
    </section>
  );
}

/** Reads the log, then what is added to it; only once if the job is over. */
async function readOn(id: number, over: boolean, show: (text: string) => void, signal: AbortSignal): Promise<void> {
  const decoder = new TextDecoder();
  let bytes = 0;
  let text = '';
  for (;;) {
    try {
      const range: Record<string, string> = bytes === 0 ? {} : { Range: `bytes=${bytes}-` };
      const response = await send('GET', `/v1/jobs/${id}/log`, { headers: range, signal });
      const piece = await response.arrayBuffer();
      if (response.status !== 206) text = '';
      bytes = response.status === 206 ? bytes + piece.byteLength : piece.byteLength;
      text += decoder.decode(piece, { stream: true });
      show(text);
    } catch (error) {
      // Nothing was added since the last read.
      if (!(error instanceof ApiError) || (error.status !== 416 && error.trouble !== 'down')) throw error;
    }
    if (over) return;
    await sleep(kEveryS, signal);
  }
}

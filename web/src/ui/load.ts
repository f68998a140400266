import { useCallback, useEffect, useRef, useState } from 'preact/hooks';
import { isAborted, toApiError, type ApiError } from '../api/errors.js';
import { onRecovery } from '../api/recovery.js';

export interface Loaded<Data> {
  /** The latest data; kept while it is loaded again, and when that fails. */
  data: Data | undefined;
  error: ApiError | undefined;
  loading: boolean;
  reload: () => void;
}

export interface LoadOptions {
  /** Loads again after this time [s], while the window is visible. */
  everyS?: number | undefined;
}

/**
 * Loads data when the component appears, when `inputs` change, and periodically if wanted. After a failure it loads again
 * when the server is back or another key is in use.
 */
export function useLoad<Data>(
  load: (signal: AbortSignal) => Promise<Data>, inputs: readonly unknown[], options: LoadOptions = {},
): Loaded<Data> {
  const [state, setState] = useState<{ data: Data | undefined; error: ApiError | undefined; loading: boolean; of: unknown }>(
    { data: undefined, error: undefined, loading: true, of: undefined });
  const [turn, setTurn] = useState(0);
  const reload = useCallback(() => setTurn((before) => before + 1), []);
  const what = JSON.stringify(inputs);
  const failed = useRef(false);
  failed.current = state.error !== undefined;

  useEffect(() => {
    const stop = new AbortController();
    setState((before) => ({ ...before, ...(before.of === what ? {} : { data: undefined, error: undefined }), loading: true, of: what }));
    load(stop.signal).then(
      (data) => stop.signal.aborted || setState({ data, error: undefined, loading: false, of: what }),
      (error: unknown) => {
        if (isAborted(error) || stop.signal.aborted) return;
        setState((before) => ({ ...before, error: toApiError(error), loading: false }));
      });
    return () => stop.abort();
  }, [what, turn]);

  useEffect(() => {
    if (options.everyS === undefined) return undefined;
    const timer = setInterval(() => document.hidden || reload(), 1000 * options.everyS);
    return () => clearInterval(timer);
  }, [options.everyS, reload]);

  useEffect(() => onRecovery(() => failed.current && reload()), [reload]);

  return { data: state.of === what ? state.data : undefined, error: state.error, loading: state.loading, reload };
}

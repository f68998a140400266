import { useEffect, useRef, useState } from 'preact/hooks';
import { createApi } from '../api.js';
import { isAborted, toApiError, type ApiError } from '../api/errors.js';
import { send } from '../api/send.js';
import { loadMap } from '../load.js';
import { Trouble } from '../ui/parts.js';
import { theme } from '../ui/theme.js';
import { Viewer } from '../viewer.js';
import type { ViewProps } from '../views.js';

/** A map in 3D. */
export default function MapView({ path }: ViewProps) {
  const map = path[0] ?? '';
  const canvas = useRef<HTMLCanvasElement>(null);
  const [error, setError] = useState<ApiError>();
  useEffect(() => {
    const stop = new AbortController();
    const ignore = (): void => undefined;
    const panel = { setFacts: ignore, setProgress: ignore, setPoints: ignore, setHeights: ignore };
    const api = createApi((url) => send('GET', String(url), { signal: stop.signal }));
    if (canvas.current === null) return undefined;
    const viewer = new Viewer(canvas.current, theme.get());
    loadMap(api, map, viewer, panel as never, stop.signal).catch((reason: unknown) => {
      if (!isAborted(reason)) setError(toApiError(reason));
    });
    return () => stop.abort();
  }, [map]);
  return (
    <>
      {error !== undefined && <Trouble error={error} />}
      <canvas ref={canvas} class="whole-canvas" tabIndex={0} role="application" aria-label={`The map ${map} in 3D`} />
    </>
  );
}

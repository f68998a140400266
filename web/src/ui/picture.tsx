import { useEffect, useRef, useState } from 'preact/hooks';
import { onRecovery } from '../api/recovery.js';
import { send } from '../api/send.js';

export interface PictureProps {
  /** Route of an image; undefined shows none. */
  path: string | undefined;
  label: string;
}

/** An image of the server on a canvas: it is requested with the key, which an `img` element cannot send. */
export function Picture({ path, label }: PictureProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [state, setState] = useState<'loading' | 'there' | 'none'>('loading');
  useEffect(() => {
    setState(path === undefined ? 'none' : 'loading');
    if (path === undefined) return undefined;
    const stop = new AbortController();
    const load = async (): Promise<void> => {
      const response = await send('GET', path, { signal: stop.signal });
      const bitmap = await createImageBitmap(await response.blob());
      if (canvas.current === null) return;
      canvas.current.width = bitmap.width;
      canvas.current.height = bitmap.height;
      canvas.current.getContext('2d')?.drawImage(bitmap, 0, 0);
      setState('there');
    };
    let failed = false;
    const begin = async (): Promise<void> => {
      failed = await load().then(() => false, () => true);
      if (failed && !stop.signal.aborted) setState('none');
    };
    void begin();
    const forget = onRecovery(() => void (failed && begin()));
    return () => {
      forget();
      stop.abort();
    };
  }, [path]);
  return (
    <div class={`picture ${state}`} role="img" aria-label={state === 'none' ? `${label}: no picture` : label}>
      <canvas ref={canvas} width={1} height={1} />
    </div>
  );
}

import { useEffect, useRef, useState } from 'preact/hooks';
import { Scene } from '../scene/scene.js';
import type { Vec3 } from '../scene/types.js';
import { useStore } from '../state/store.js';
import { theme } from './theme.js';

interface Props {
  /** Map coordinates of the scene's origin [m]; a change makes a new scene. */
  origin: Vec3;
  /** What the picture shows and how to move in it, for screen readers. */
  label: string;
  /** Called with the scene once it is made, and with undefined before it goes. */
  onScene: (scene: Scene | undefined) => void;
}

/** A canvas with a scene, which lives as long as the canvas is part of the page. */
export function SceneCanvas({ origin, label, onScene }: Props) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const scene = useRef<Scene>();
  const [fault, setFault] = useState<string>();
  const colours = useStore(theme);
  useEffect(() => {
    if (canvas.current === null) return undefined;
    let made: Scene;
    try {
      made = new Scene(canvas.current, colours, origin);
    } catch (error) {
      setFault(error instanceof Error ? error.message : String(error));
      return undefined;
    }
    scene.current = made;
    onScene(made);
    return () => {
      onScene(undefined);
      scene.current = undefined;
      made.dispose();
    };
  }, [origin.join()]);
  useEffect(() => scene.current?.setTheme(colours), [colours]);
  return (
    <>
      <canvas ref={canvas} class="scene" tabIndex={0} role="application" aria-roledescription="3D view" aria-label={label} />
      {fault !== undefined && <p class="trouble" role="alert">This browser cannot draw in 3D ({fault}). Turn on WebGL 2 or hardware acceleration in its settings, or use another browser.</p>}
    </>
  );
}

/** Says in the picture that tiles are missing; nothing while there is no such text. */
export function StageTrouble({ text, onRetry }: { text: string | undefined; onRetry: () => void }) {
  if (text === undefined) return null;
  return (
    <div class="stage-trouble trouble" role="alert">
      <p>{text}</p>
      <button type="button" onClick={onRetry}>Try again</button>
    </div>
  );
}

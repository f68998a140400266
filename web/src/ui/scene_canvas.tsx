import { useEffect, useRef, useState } from 'preact/hooks';
import { Scene } from '../scene/scene.js';
import type { Vec3 } from '../scene/types.js';
import { useStore } from '../state/store.js';
import { theme } from './theme.js';

interface Props {
  /** Map coordinates of the scene's zero [m]; another one makes another scene. */
  origin: Vec3;
  /** What the picture shows and how it is steered, for those who do not see it. */
  label: string;
  /** The scene once it stands, undefined when it is gone. What it returns is called before that. */
  onScene: (scene: Scene | undefined) => void;
}

/** A canvas with a scene in it, as long as it is part of the page. */
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
      {fault !== undefined && <p class="trouble" role="alert">This browser cannot draw in 3D (WebGL 2 is missing or off): {fault}</p>}
    </>
  );
}

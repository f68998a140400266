import { useEffect, useRef } from 'preact/hooks';
import { between, metres } from '../scene/measure.js';
import type { Vec3 } from '../scene/types.js';
import { useStore } from '../state/store.js';
import type { ViewerModel } from './model.js';

/** Lengths beside the segments of the measured line; they move with the picture. */
export function LineLabels({ model }: { model: ViewerModel }) {
  const line = useStore(model.tools.line);
  const box = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const place = (): void => {
      [...(box.current?.children ?? [])].forEach((label, i) => {
        const [a, b] = [line[i], line[i + 1]];
        // A frame may come between a new label and this line.
        if (a === undefined || b === undefined) return;
        const middle: Vec3 = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2];
        const at = model.scene.project(middle);
        const element = label as HTMLElement;
        element.hidden = at === null;
        if (at !== null) element.style.transform = `translate(${at.x.toFixed(1)}px, ${at.y.toFixed(1)}px) translate(-50%, -140%)`;
      });
    };
    place();
    return model.scene.onFrame(place);
  }, [line, model]);
  return (
    <div ref={box} class="viewer-labels" aria-hidden="true">
      {line.slice(1).map((place, i) => <span key={i}>{metres(between(line[i] as Vec3, place).straight)}</span>)}
    </div>
  );
}

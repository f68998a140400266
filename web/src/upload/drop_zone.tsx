import type { ComponentChildren } from 'preact';
import { useEffect, useRef, useState } from 'preact/hooks';
import { toApiError } from '../api/errors.js';
import { say } from '../ui/notices.js';
import { fromDrop, type Chosen } from './chosen.js';

export interface DropZoneProps {
  /** Called with the first file or folder of a drop. */
  onChosen: (chosen: Chosen) => void;
  children: ComponentChildren;
}

/** Accepts files and folders that are dropped anywhere in the window, and shows that it does. */
export function DropZone({ onChosen, children }: DropZoneProps) {
  const [over, setOver] = useState(false);
  const take = useRef(onChosen);
  take.current = onChosen;
  useEffect(() => {
    const listeners = dropListeners(setOver, (chosen) => take.current(chosen));
    for (const [type, listener] of listeners) window.addEventListener(type, listener);
    return () => {
      for (const [type, listener] of listeners) window.removeEventListener(type, listener);
    };
  }, []);
  return (
    <>
      {children}
      {over && <div class="drop-over" aria-hidden="true"><p>Drop to upload</p></div>}
    </>
  );
}

function dropListeners(
  setOver: (over: boolean) => void, take: (chosen: Chosen) => void,
): [string, (event: Event) => void][] {
  let depth = 0;
  const isFiles = (event: Event): event is DragEvent =>
    event instanceof DragEvent && event.dataTransfer?.types.includes('Files') === true;
  const move = (by: number) => (event: Event): void => {
    if (!isFiles(event)) return;
    depth = Math.max(0, depth + by);
    setOver(depth > 0);
  };
  const drop = (event: Event): void => {
    depth = 0;
    setOver(false);
    if (!isFiles(event) || event.defaultPrevented || event.dataTransfer === null) return;
    event.preventDefault();
    fromDrop(event.dataTransfer).then(
      ([first]) => first !== undefined && take(first),
      (error: unknown) => say({ kind: 'bad', text: toApiError(error).message }));
  };
  return [
    ['dragenter', move(1)], ['dragleave', move(-1)], ['dragover', (event) => isFiles(event) && event.preventDefault()], ['drop', drop],
  ];
}

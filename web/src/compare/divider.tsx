import { useRef } from 'preact/hooks';

interface Props {
  /** Share of the width that shows A, in [0, 1]. */
  share: number;
  onShare: (share: number) => void;
  a: string;
  b: string;
}

const kStep = 0.02;

/** The line between two versions. It is dragged, or moved with the arrow keys. */
export function Divider({ share, onShare, a, b }: Props) {
  const element = useRef<HTMLDivElement>(null);
  const follow = (event: PointerEvent): void => {
    const frame = element.current?.parentElement?.getBoundingClientRect();
    if (frame) onShare(Math.min(1, Math.max(0, (event.clientX - frame.left) / frame.width)));
  };
  const key = (event: KeyboardEvent): void => {
    const next = { ArrowLeft: share - kStep, ArrowRight: share + kStep, Home: 0, End: 1, PageDown: share - 0.1, PageUp: share + 0.1 }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    onShare(Math.min(1, Math.max(0, next)));
  };
  const percent = Math.round(100 * share);
  return (
    <div
      ref={element} class="divider" role="slider" tabIndex={0} aria-label={`Line between ${a} and ${b}`} aria-orientation="horizontal"
      aria-valuemin={0} aria-valuemax={100} aria-valuenow={percent} aria-valuetext={`${percent} % ${a}, ${100 - percent} % ${b}`}
      style={{ left: `${100 * share}%` }}
      onPointerDown={(event) => {
        event.preventDefault();
        element.current?.focus();
        element.current?.setPointerCapture(event.pointerId);
      }}
      onPointerMove={(event) => element.current?.hasPointerCapture(event.pointerId) && follow(event)}
      onKeyDown={key}
    >
      <span class="divider-grip" aria-hidden="true">
        <svg viewBox="0 0 20 20" width="20" height="20"><path d="M8 4.5 2.500 10 8 15.500M12 4.500 17.500 10 12 15.500" /></svg>
      </span>
    </div>
  );
}

import { useEffect, useRef } from 'preact/hooks';
import { Icon } from '../ui/icon.js';
import type { Answer } from './answer.js';
import type { DriveRun } from './drive_run.js';
import { kStatusWords } from './words.js';

interface Props {
  run: DriveRun;
  shown: number;
  onShow: (index: number) => void;
  playing: boolean;
  onPlaying: (playing: boolean) => void;
  onSpeed: (perSecond: number) => void;
  perSecond: number;
}

const kSpeeds = [2, 5, 10, 20] as const;

/** A drive's scans as a strip of verdicts, with a slider and playback. */
export function DriveStrip({ run, shown, onShow, playing, onPlaying, perSecond, onSpeed }: Props) {
  const last = Math.max(0, run.answers.length - 1);
  const counts = countOf(run.answers);
  const running = run.state === 'running';
  return (
    <section class="drive" aria-label="Drive">
      <p class="drive-state" role="status">
        {run.answers.length} of {run.scans} scans: {counts.ok} found, {counts.degraded} uncertain, {counts.lost} not found
      </p>
      <Strip answers={run.answers} scans={run.scans} shown={shown} />
      <input
        type="range" class="strip-slider" min={0} max={last} value={shown} disabled={run.answers.length === 0} aria-label="Scan shown"
        aria-valuetext={`Scan ${shown + 1} of ${run.answers.length}: ${verdictOf(run.answers[shown])}`}
        onInput={(event) => onShow(Number(event.currentTarget.value))}
      />
      <div class="row">
        {run.state !== 'done' && (
          <button type="button" class="small" onClick={() => (running ? run.pause() : void run.play())}>
            <Icon name={running ? 'pause' : 'play'} /> {running ? 'Pause' : run.answers.length === 0 ? 'Start' : 'Resume'}
          </button>
        )}
        <button type="button" class="small" disabled={run.answers.length < 2 || running} onClick={() => onPlaying(!playing)}>
          <Icon name={playing ? 'pause' : 'play'} /> {playing ? 'Stop' : 'Replay'}
        </button>
        <label class="inline">
          <span class="quiet">scans per second</span>
          <select value={perSecond} onChange={(event) => onSpeed(Number(event.currentTarget.value))}>
            {kSpeeds.map((speed) => <option key={speed} value={speed}>{speed}</option>)}
          </select>
        </label>
      </div>
    </section>
  );
}

const verdictOf = (answer: Answer | undefined): string => (answer === undefined ? 'none' : kStatusWords[answer.status].title);

function countOf(answers: readonly Answer[]): Record<Answer['status'], number> {
  const counts = { ok: 0, degraded: 0, lost: 0 };
  for (const answer of answers) counts[answer.status] += 1;
  return counts;
}

const kStripHeight = 22;

/** One bar per scan, in the colour of its verdict. On a canvas, since a drive may have thousands. */
function Strip({ answers, scans, shown }: { answers: readonly Answer[]; scans: number; shown: number }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const many = answers.length;
  useEffect(() => {
    const element = canvas.current;
    const context = element?.getContext('2d');
    if (!element || !context) return;
    const ratio = window.devicePixelRatio;
    element.width = Math.round(element.clientWidth * ratio);
    element.height = Math.round(kStripHeight * ratio);
    const style = getComputedStyle(element);
    const colours = { ok: style.getPropertyValue('--ok'), degraded: style.getPropertyValue('--degraded'), lost: style.getPropertyValue('--lost') };
    const width = element.width / scans;
    answers.forEach((answer, i) => {
      context.fillStyle = colours[answer.status];
      const high = answer.status === 'ok' ? 0.62 : answer.status === 'degraded' ? 0.8 : 1;
      context.fillRect(i * width, element.height * (1 - high), Math.max(1, width - (width > 3 ? 1 : 0)), element.height * high);
    });
    context.strokeStyle = style.color;
    context.lineWidth = ratio;
    context.strokeRect(shown * width, 0.5 * ratio, Math.max(2, width), element.height - ratio);
  }, [many, scans, shown]);
  return <canvas ref={canvas} class="strip" aria-hidden="true" />;
}

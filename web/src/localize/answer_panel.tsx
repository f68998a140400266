import { CopyButton } from '../ui/parts.js';
import type { Answer } from './answer.js';
import { ErrorPlot } from './error_plot.js';
import { headingOf, type Pose } from './pose.js';
import { freeDirection } from './uncertainty.js';
import { angleWords, kStatusWords, lengthWords, reasonWords, type Status } from './words.js';

function StatusBadge({ status }: { status: Status }) {
  return <span class={`verdict ${status}`}>{kStatusWords[status].title}</span>;
}

/** The server's answer for a scan. @param magnified scale of the ellipse in the 3D picture. */
export function AnswerPanel({ answer, roundTrip_ms, curl, magnified }: {
  answer: Answer;
  roundTrip_ms: number | null;
  curl: string | null;
  magnified: number;
}) {
  const { pose } = answer;
  return (
    <section class="answer" aria-label="Answer" aria-live="polite" data-status={answer.status}>
      <p class="verdict-line"><StatusBadge status={answer.status} /> {kStatusWords[answer.status].meaning}</p>
      {answer.reasons.length > 0 && (
        <ul class="reasons">
          {answer.reasons.map((reason) => <li key={reason}>{reasonWords(reason)} <code>{reason}</code></li>)}
        </ul>
      )}
      {pose !== null && answer.covariance !== null && (
        <>
          <ErrorPlot pose={pose} covariance={answer.covariance} protection={answer.protection} />
          {magnified > 1 && <p class="quiet">In the 3D picture the ellipse is drawn {magnified} times larger.</p>}
        </>
      )}
      {pose !== null && answer.degenerate.length > 0 && (
        <p class="free">
          <span class="key free" /> The scan {answer.degenerate.map((direction) => freeDirection(pose, direction).words).join(', and ')}: the surroundings do not constrain it there.
        </p>
      )}
      <Facts answer={answer} pose={pose} />
      <Timings answer={answer} roundTrip_ms={roundTrip_ms} />
      {curl !== null && (
        <div class="row">
          <CopyButton text={curl} label="Copy as curl" />
          <span class="quiet">request id {answer.requestId}</span>
        </div>
      )}
    </section>
  );
}

function Facts({ answer, pose }: { answer: Answer; pose: Pose | null }) {
  const facts: [string, string][] = [];
  if (pose !== null) {
    facts.push(['Position', `${pose.position.map((value) => value.toFixed(2)).join(', ')} m`]);
    facts.push(['Heading', `${angleWords(headingOf(pose))} from east`]);
  }
  if (answer.priorToPose !== null) {
    facts.push(['From the prior', `${lengthWords(answer.priorToPose.m)}, ${angleWords(answer.priorToPose.rad)}`]);
  }
  facts.push(['Inliers', `${(100 * answer.inlierRatio).toFixed(1)} % of the scan`]);
  facts.push(['RMSE', lengthWords(answer.rmse_m)]);
  if (answer.searchedFrom !== null) facts.push(['Searched from', kSearchedFrom[answer.searchedFrom] ?? answer.searchedFrom]);
  facts.push(['Iterations', String(answer.iterations)], ['Version', answer.version]);
  return <dl class="facts">{facts.map(([name, value]) => <div key={name}><dt>{name}</dt><dd>{value}</dd></div>)}</dl>;
}

const kSearchedFrom: Record<string, string> = {
  given: 'the given prior', velocity: 'the previous motion', odometry: 'the odometry', interpolation: 'the neighbouring poses',
  everywhere: 'the whole map', nowhere: 'nowhere',
};

const kStages = [['wait', 'waiting'], ['decode', 'decoding'], ['align', 'alignment']] as const;

function Timings({ answer, roundTrip_ms }: { answer: Answer; roundTrip_ms: number | null }) {
  const { total } = answer.timing_ms;
  const words = kStages.map(([key, word]) => `${answer.timing_ms[key].toFixed(1)} ms ${word}`).join(', ');
  return (
    <div class="timings">
      <p>
        {total.toFixed(1)} ms on the server
        {roundTrip_ms !== null && <span class="quiet">, {roundTrip_ms.toFixed(0)} ms with the network</span>}
      </p>
      <div class="timing-bar" role="img" aria-label={words}>
        {kStages.map(([key, word]) => <span key={key} class={`part ${key}`} title={word} style={{ width: `${total > 0 ? (100 * answer.timing_ms[key]) / total : 0}%` }} />)}
      </div>
      <p class="quiet">{words}</p>
    </div>
  );
}

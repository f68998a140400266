import { bytes, duration } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { Progress } from '../ui/parts.js';
import { useStore } from '../state/store.js';
import { kKindWords } from './kind.js';
import { linkTo } from '../state/router.js';
import { dismiss, needsChoice, uploads, type Upload } from './manager.js';
import type { TransferView } from './transfer.js';

/** The uploads of this window, shown at its lower edge. */
export function UploadTray() {
  const all = useStore(uploads);
  if (all.length === 0) return null;
  return (
    <section class="tray" aria-label="Uploads">
      {all.map((upload) => <Row key={upload.id} upload={upload} />)}
    </section>
  );
}

function Row({ upload }: { upload: Upload }) {
  const { plan, transfer } = upload;
  const view = useStore(transfer.view);
  const isOver = view.state === 'done' || view.state === 'canceled';
  const canClose = isOver || view.state === 'failed';
  const canResume = view.state === 'paused' || view.state === 'failed';
  return (
    <div class={`upload ${view.state}`} data-state={view.state}>
      <div class="upload-head">
        <strong title={plan.chosen.name}>{plan.chosen.name}</strong>
        <span class="quiet">{kKindWords[plan.kind]} to {plan.map}</span>
        <span class="grow" />
        {view.state === 'sending' && (
          <button type="button" class="plain small" onClick={() => transfer.pause()}><Icon name="pause" /> Pause</button>
        )}
        {canResume && (
          <button type="button" class="plain small" onClick={() => void transfer.run()}>
            <Icon name="play" /> {view.state === 'paused' ? 'Resume' : 'Try again'}
          </button>
        )}
        <button
          type="button" class="plain small" onClick={() => void dismiss(upload)}
          aria-label={canClose ? `Close ${plan.chosen.name}` : `Discard the upload of ${plan.chosen.name}`}
        >
          <Icon name="close" /> {!canClose && 'Discard'}
        </button>
      </div>
      {!isOver && <Progress value={shareOf(view)} label={`Upload of ${plan.chosen.name}`} />}
      <p class={view.state === 'failed' ? 'fault' : 'quiet'}>
        {wordsOf(view)}
        {needsChoice(view.outcome) && <>: <a href={linkTo('maps', [plan.map])}>choose the topics</a> of this recording</>}
      </p>
    </div>
  );
}

function shareOf({ state, sent, bytes: all }: TransferView): number | undefined {
  if (state === 'starting' || state === 'checking' || state === 'comparing') return undefined;
  return all === 0 ? 1 : sent / all;
}

function wordsOf(view: TransferView): string {
  const amount = `${bytes(view.sent)} of ${bytes(view.bytes)}`;
  switch (view.state) {
    case 'starting': return 'Starting…';
    case 'comparing': return 'Comparing with the parts on the server…';
    case 'sending': return [amount, rateOf(view), leftOf(view)].filter(Boolean).join(' · ');
    case 'waiting': return `${amount} · ${view.error?.message ?? ''} The upload continues when the server answers.`;
    case 'paused': return `Paused at ${amount}`;
    case 'checking': return 'Sent. The server is checking it…';
    case 'done': return 'Done';
    case 'failed': return [view.error?.message, ...(view.error?.faults ?? []).map((fault) => `${fault.path}: found ${fault.found}, expected ${fault.expected}.`)].join(' ');
    case 'canceled': return 'Discarded';
  }
}

function rateOf({ bytesPerS }: TransferView): string {
  return bytesPerS === undefined ? '' : `${bytes(bytesPerS)}/s`;
}

function leftOf({ etaS }: TransferView): string {
  return etaS === undefined ? '' : `${duration(Math.ceil(etaS))} left`;
}

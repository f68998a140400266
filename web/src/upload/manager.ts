// The uploads of this window. They go on while the person looks at other views.

import { ask } from '../api/client.js';
import { toApiError } from '../api/errors.js';
import { linkTo } from '../state/router.js';
import { say } from '../ui/notices.js';
import { Store } from '../state/store.js';
import type { Chosen } from './chosen.js';
import { collectionOf, kKindWords, kPointTypes, type Kind, type Packing } from './kind.js';
import { begunWith, forgetUpload, remember } from './remembered.js';
import { PartsTarget, type Outcome, type Target } from './target.js';
import { isUnderWay, Transfer } from './transfer.js';

/** What is to be sent where. */
export interface UploadPlan {
  map: string;
  kind: Kind;
  /** Of the version that it becomes; of a drive its name. */
  name: string;
  chosen: Chosen;
  /** Number of the drive, or of the upload, that was begun before. */
  goOn?: number | undefined;
}

export interface Upload {
  id: number;
  plan: UploadPlan;
  transfer: Transfer;
}

export const uploads = new Store<readonly Upload[]>([]);
let last = 0;
/** How long what is done stays in the tray, which lies over the view [ms]. */
const kDoneShownMs = 10_000;

/** Begins an upload; what becomes of it is told at the window's edge and in the tray. */
export function startUpload(plan: UploadPlan): Upload {
  const upload = { id: ++last, plan, transfer: new Transfer(plan.chosen.content, targetOf(plan)) };
  uploads.set([...uploads.get(), upload]);
  upload.transfer.view.listen(({ state, outcome, error }) => {
    if (state === 'done' && outcome !== undefined) {
      finished(plan, outcome);
      setTimeout(() => void dismiss(upload), kDoneShownMs);
    }
    if (state === 'failed' && error !== undefined) say({ kind: 'bad', text: `${plan.chosen.name}: ${error.message}` });
  });
  void upload.transfer.run();
  return upload;
}

/** Takes it off the list; one that has not ended is broken off and taken back. What failed stays on the server as it is. */
export async function dismiss(upload: Upload): Promise<void> {
  const { state } = upload.transfer.view.get();
  try {
    if (state !== 'done' && state !== 'canceled' && state !== 'failed') await upload.transfer.cancel();
  } catch (error) {
    say({ kind: 'bad', text: `${upload.plan.chosen.name}: ${toApiError(error).message}` });
  }
  uploads.set(uploads.get().filter(({ id }) => id !== upload.id));
}

/** The browser asks before the page is left while something is under way. */
export function guardUploads(): void {
  window.addEventListener('beforeunload', (event) => {
    if (uploads.get().some(({ transfer }) => isUnderWay(transfer.view.get().state))) event.preventDefault();
  });
}

function targetOf(plan: UploadPlan): Target {
  const { map, kind, name, chosen, goOn } = plan;
  const collection = collectionOf(kind);
  const opened = (id: number): void =>
    remember({ map, collection, id, name: chosen.name, bytes: chosen.content.size, changedMs: chosen.changedMs });
  if (kind === 'drive') {
    const target = new PartsTarget(map, collection, { name }, goOn, opened);
    return goOn === undefined ? withMap(map, target) : target;
  }
  return new PartsTarget(map, collection, { version: name, content_type: contentType(kind, packingOf(chosen)) }, goOn, opened);
}

/** A drive belongs to a map, which is made where it is new. */
function withMap(map: string, target: Target): Target {
  return {
    begin: async (signal) => {
      await ask('put', '/v1/maps/{map}', { path: { map }, signal });
      return target.begin(signal);
    },
    put: (...args) => target.put(...args),
    finish: (signal) => target.finish(signal),
    discard: () => target.discard(),
  };
}

function packingOf({ look }: Chosen): Packing {
  return 'kind' in look ? (look.packing ?? 'tar') : 'tar';
}

function contentType(kind: Kind, packing: Packing): string {
  if (kind === 'pcd' || kind === 'ply' || kind === 'las') return kPointTypes[kind];
  return { tar: 'application/x-tar', gzip: 'application/gzip', zstd: 'application/zstd' }[packing];
}

function finished({ map, kind, name, chosen }: UploadPlan, outcome: Outcome): void {
  const begun = begunWith({
    map, collection: collectionOf(kind), name: chosen.name, bytes: chosen.content.size, changedMs: chosen.changedMs,
  });
  if (begun !== undefined) forgetUpload(map, begun.collection, begun.id);
  const link = { href: linkTo('maps', [map]), text: `Show ${map}` };
  if (outcome.is === 'drive') {
    say({ kind: 'good', text: `The drive “${name}” is complete.`, link });
  } else if (outcome.is === 'job') {
    say({ kind: 'good', text: `${kKindWords[kind]}: “${name}” is being converted.`, link: { href: linkTo('jobs', [String(outcome.job)]), text: `Job ${outcome.job}` } });
  } else {
    const text = outcome.wasThere ? `The same was already there as ${outcome.version}.` : `${outcome.version} is stored; vehicles get it when it is published.`;
    say({ kind: 'good', text, link });
  }
}

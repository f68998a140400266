// The uploads of this window. They continue while the person looks at other views.

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

/** What to send, and where to. */
export interface UploadPlan {
  map: string;
  kind: Kind;
  /** Name of the new version or drive. */
  name: string;
  chosen: Chosen;
  /** Number of the drive or upload that was started before. */
  resume?: number | undefined;
  /** Which topics of a recording are used; empty or undefined if that was not asked. */
  choice?: string | undefined;
}

export interface Upload {
  id: number;
  plan: UploadPlan;
  transfer: Transfer;
}

export const uploads = new Store<readonly Upload[]>([]);
let last = 0;
/** How long a finished upload stays in the tray, which covers part of the view [ms]. */
const kDoneShownMs = 10_000;

/** Starts an upload; a notice and the tray show its result. */
export function startUpload(plan: UploadPlan): Upload {
  const upload = { id: ++last, plan, transfer: new Transfer(plan.chosen.content, targetOf(plan)) };
  uploads.set([...uploads.get(), upload]);
  upload.transfer.view.listen(({ state, outcome, error }) => {
    if (state === 'done' && outcome !== undefined) {
      finished(plan, outcome);
      if (!needsChoice(outcome)) setTimeout(() => void dismiss(upload), kDoneShownMs);
    }
    if (state === 'failed' && error !== undefined) say({ kind: 'bad', text: `${plan.chosen.name}: ${error.message}` });
  });
  void upload.transfer.run();
  return upload;
}

/** Removes an upload from the list. One that has not ended is cancelled and deleted; a failed one stays on the server. */
export async function dismiss(upload: Upload): Promise<void> {
  const { state } = upload.transfer.view.get();
  try {
    if (state !== 'done' && state !== 'canceled' && state !== 'failed') await upload.transfer.cancel();
  } catch (error) {
    say({ kind: 'bad', text: `${upload.plan.chosen.name}: ${toApiError(error).message}` });
  }
  uploads.set(uploads.get().filter(({ id }) => id !== upload.id));
}

/** Removes the uploads of a drive that was deleted, or whose topics were chosen, from the list. */
export function dismissDrive(map: string, drive: number): void {
  for (const upload of uploads.get()) {
    const { outcome } = upload.transfer.view.get();
    if (upload.plan.map === map && outcome?.is === 'drive' && outcome.drive === drive) void dismiss(upload);
  }
}

/** Lets the browser ask before the page is left during an upload. */
export function guardUploads(): void {
  window.addEventListener('beforeunload', (event) => {
    if (uploads.get().some(({ transfer }) => isUnderWay(transfer.view.get().state))) event.preventDefault();
  });
}

function targetOf(plan: UploadPlan): Target {
  const { map, kind, name, chosen, resume, choice } = plan;
  const collection = collectionOf(kind);
  const opened = (id: number): void =>
    remember({ map, collection, id, name: chosen.name, bytes: chosen.content.size, changedMs: chosen.changedMs });
  if (kind === 'drive') {
    const complete = choice === undefined || choice === '' ? undefined : { choice };
    const target = new PartsTarget(map, collection, { open: { name }, complete }, resume, opened);
    return resume === undefined ? withMap(map, target) : target;
  }
  return new PartsTarget(map, collection, { open: { version: name, content_type: contentType(kind, packingOf(chosen)) } }, resume, opened);
}

/** A drive belongs to a map, which is created if it is new. */
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

/** Whether the server asks which topics of the recording are used. */
export function needsChoice(outcome: Outcome | undefined): boolean {
  return outcome?.is === 'drive' && outcome.needsChoice;
}

function finished({ map, kind, name, chosen }: UploadPlan, outcome: Outcome): void {
  const begun = begunWith({
    map, collection: collectionOf(kind), name: chosen.name, bytes: chosen.content.size, changedMs: chosen.changedMs,
  });
  if (begun !== undefined) forgetUpload(map, begun.collection, begun.id);
  const link = { href: linkTo('maps', [map]), text: `Show ${map}` };
  if (needsChoice(outcome)) {
    say({ kind: 'plain', text: `Uploaded the drive “${name}”. Choose its topics before you build a map from it.`, link });
  } else if (outcome.is === 'drive') {
    say({ kind: 'good', text: `Uploaded the drive “${name}”.`, link });
  } else if (outcome.is === 'job') {
    say({ kind: 'good', text: `${kKindWords[kind]}: “${name}” is being converted to a map package.`, link: { href: linkTo('jobs', [String(outcome.job)]), text: `Job ${outcome.job}` } });
  } else {
    const text = outcome.wasThere ? `This package is already stored as ${outcome.version}.` : `${outcome.version} is stored. Vehicles use it after you activate it.`;
    say({ kind: 'good', text, link });
  }
}

import { useState } from 'preact/hooks';
import { ask, type Schema } from '../api/client.js';
import { toApiError } from '../api/errors.js';
import { age, bytes } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { useLoad } from '../ui/load.js';
import { say } from '../ui/notices.js';
import { useStore } from '../state/store.js';
import { UploadDialog } from '../upload/dialog.js';
import { kindOfType, kKindWords } from '../upload/kind.js';
import { uploads } from '../upload/manager.js';
import { forgetUpload, remembered } from '../upload/remembered.js';

type Listed = Schema<'UploadListed'>;

/** Packages and map files whose upload was interrupted; nothing if there are none. */
export function UnfinishedUploads({ map }: { map: string }) {
  const { data, reload } = useLoad(async (signal) =>
    (await ask('get', '/v1/maps/{map}/uploads', { path: { map }, signal })).data.uploads, [map], { everyS: 5 });
  const [open, setOpen] = useState<Listed>();
  const here = useStore(uploads);
  const list = (data ?? []).filter(({ status, version }) => status === 'open' && !here.some(({ plan, transfer }) =>
    plan.map === map && plan.kind !== 'drive' && plan.name === version && transfer.view.get().state !== 'failed'));
  const remove = (upload: Listed): void => {
    ask('delete', '/v1/maps/{map}/uploads/{upload}', { path: { map, upload: upload.id } }).then(
      () => {
        forgetUpload(map, 'uploads', upload.id);
        reload();
      },
      (error: unknown) => say({ kind: 'bad', text: toApiError(error).message }));
  };
  if (list.length === 0 && open === undefined) return null;
  return (
    <section aria-labelledby="unfinished">
      <h2 id="unfinished">Interrupted uploads</h2>
      {list.map((upload) => (
        <div key={upload.id} class="card unfinished" data-upload={upload.id}>
          <span><strong>{upload.version}</strong> <span class="quiet">{kKindWords[kindOfType(upload.content_type)]}, started {age(upload.created_ns)}, {shareOf(map, upload)}</span></span>
          <span class="grow" />
          <button type="button" class="small" onClick={() => setOpen(upload)}>Resume the upload</button>
          <button type="button" class="plain small" aria-label={`Discard the upload of ${upload.version}`} onClick={() => remove(upload)}><Icon name="trash" /></button>
        </div>
      ))}
      {open !== undefined && (
        <UploadDialog map={map} resume={{ id: open.id, name: open.version, kind: kindOfType(open.content_type) }} onClose={() => setOpen(undefined)} />
      )}
    </section>
  );
}

function shareOf(map: string, { id, bytes: there }: Listed): string {
  const known = remembered().find((one) => one.map === map && one.collection === 'uploads' && one.id === id);
  return known === undefined || known.bytes === 0 ? `${bytes(there)} arrived` : `${Math.floor((100 * there) / known.bytes)} % of ${bytes(known.bytes)}`;
}

import './keys.css';
import { useState } from 'preact/hooks';
import { ask, type Schema } from '../api/client.js';
import { Confirm } from '../ui/confirm.js';
import { age, date, toDate } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import { useLoad } from '../ui/load.js';
import { say } from '../ui/notices.js';
import { Badge, Trouble } from '../ui/parts.js';
import type { ViewProps } from '../state/router.js';
import { NewKeyDialog } from './new_key_dialog.js';

type Key = Schema<'Key'>;

/** The API keys, for administrators of the server. */
export default function KeysView(_: ViewProps) {
  const { data, error, loading, reload } = useLoad(async (signal) => (await ask('get', '/v1/keys', { signal })).data.keys, []);
  const [open, setOpen] = useState<'new' | Key>();
  const close = (): void => setOpen(undefined);
  return (
    <>
      <div class="heading">
        <h1>Keys</h1>
        <span class="grow" />
        {data !== undefined && data.length > 0 && <button type="button" class="primary" onClick={() => setOpen('new')}><Icon name="plus" /> New key</button>}
      </div>
      {error !== undefined && <Trouble error={error} title={error.status === 403 ? 'Only a key with the scope “admin” can manage keys' : undefined} onRetry={reload} />}
      {data === undefined && loading && <p class="waiting" role="status">Loading the keys…</p>}
      {data?.length === 0 && (
        <p class="remark">
          The server has no keys, so anyone who can reach it can do everything. Create the first key on the server’s machine:{' '}
          <code>stillmap keys create NAME --store DIR --scope admin</code>. After that every request needs a key, and you can create more keys on this page.
        </p>
      )}
      {data !== undefined && data.length > 0 && <KeyTable keys={data} onRevoke={setOpen} />}
      {open === 'new' && <NewKeyDialog onClose={close} onMade={reload} />}
      {typeof open === 'object' && <Revoke of={open} onClose={close} onDone={reload} />}
    </>
  );
}

function KeyTable({ keys, onRevoke }: { keys: readonly Key[]; onRevoke: (key: Key) => void }) {
  return (
    <div class="card table-frame">
      <table>
        <thead>
          <tr>
            <th scope="col">Name</th><th scope="col">Id</th><th scope="col">Scopes</th><th scope="col">Maps</th><th scope="col">Created</th>
            <th scope="col">State</th><th scope="col"><span class="unseen">Actions</span></th>
          </tr>
        </thead>
        <tbody>
          {keys.map((key) => (
            <tr key={key.id} data-key={key.name}>
              <th scope="row" class="name">{key.name}</th>
              <td><code>{key.id}</code></td>
              <td><span class="scopes">{key.scopes.map((scope) => <Badge key={scope} tone="plain">{scope}</Badge>)}</span></td>
              <td>{key.maps === null ? 'all' : key.maps.join(', ')}</td>
              <td title={date(key.created_ns)}>{age(key.created_ns)}</td>
              <td><State of={key} /></td>
              <td class="end">
                {key.revoked_ns === null && <button type="button" class="small" aria-label={`Revoke ${key.name}`} onClick={() => onRevoke(key)}>Revoke</button>}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function State({ of: { revoked_ns: revoked, expires_ns: expires } }: { of: Key }) {
  if (revoked !== null) return <Badge tone="bad">Revoked {age(revoked)}</Badge>;
  if (expires === null) return <Badge tone="good">Valid</Badge>;
  if (toDate(expires) < new Date()) return <Badge tone="bad">Expired {age(expires)}</Badge>;
  return <Badge tone="good">Valid until {date(expires)}</Badge>;
}

function Revoke({ of: key, onClose, onDone }: { of: Key; onClose: () => void; onDone: () => void }) {
  const act = async (): Promise<void> => {
    await ask('delete', '/v1/keys/{key}', { path: { key: key.id } });
    say({ kind: 'good', text: `Revoked the key “${key.name}”.` });
    onDone();
  };
  return (
    <Confirm title={`Revoke “${key.name}”?`} verb="Revoke the key" danger act={act} onClose={onClose}>
      <p>From the next request on, the server refuses this key, and ends the event streams that it opened. You cannot undo this.</p>
    </Confirm>
  );
}

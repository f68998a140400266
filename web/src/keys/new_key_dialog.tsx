import { useState } from 'preact/hooks';
import { ask, type Schema } from '../api/client.js';
import { toApiError, type ApiError } from '../api/errors.js';
import { Dialog } from '../ui/dialog.js';
import { useKept, forget } from '../ui/kept.js';
import { CopyButton, Field, Trouble } from '../ui/parts.js';

type Scope = Schema<'NewKey'>['scopes'][number];

const kScopes: [Scope, string][] = [
  ['read', 'see maps, drives and jobs'],
  ['localize', 'request poses, track vehicles'],
  ['write', 'upload, build, activate, delete'],
  ['admin', 'create and revoke keys, read the audit log'],
];

export interface NewKeyDialogProps {
  onClose: () => void;
  onMade: () => void;
}

/** Creates a key, and shows it once. */
export function NewKeyDialog({ onClose, onMade }: NewKeyDialogProps) {
  const [made, setMade] = useState<Schema<'CreatedKey'>>();
  if (made !== undefined) return <Made made={made} onClose={onClose} />;
  const done = (key: Schema<'CreatedKey'>): void => {
    setMade(key);
    forget('new_key');
    onMade();
  };
  return <Form onClose={onClose} onMade={done} />;
}

function Form({ onClose, onMade }: { onClose: () => void; onMade: (key: Schema<'CreatedKey'>) => void }) {
  const [form, setForm] = useKept('new_key', { name: '', scopes: ['read'] as Scope[], maps: '', days: '' });
  const [error, setError] = useState<ApiError>();
  const [tried, setTried] = useState(false);
  const maps = form.maps.split(/[\s,]+/).filter((pattern) => pattern !== '');
  const days = form.days === '' ? undefined : Number(form.days);
  const faults = {
    name: form.name.trim() === '' ? 'Enter a name, so that you can tell keys apart.' : form.name.length > 100 ? 'Use at most 100 characters.' : undefined,
    days: days !== undefined && !(Number.isInteger(days) && days >= 1 && days <= 36500) ? 'Enter 1 to 36500 days, or nothing for a key that does not expire.' : undefined,
    scopes: form.scopes.length === 0 ? 'Choose at least one scope.' : undefined,
    maps: maps.length > 32 || maps.some((pattern) => !/^[a-z0-9._*-]{1,63}$/.test(pattern)) ? 'Enter at most 32 names of a to z, 0 to 9, . _ - and *.'
      : maps.length > 0 && form.scopes.includes('admin') ? 'A key with the scope “admin” is valid for all maps: leave this empty.' : undefined,
  };
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    setTried(true);
    setError(undefined);
    if (Object.values(faults).some((fault) => fault !== undefined)) return;
    try {
      const json = { name: form.name.trim(), scopes: form.scopes, ...(days === undefined ? {} : { expires_days: days }), ...(maps.length === 0 ? {} : { maps }) };
      onMade((await ask('post', '/v1/keys', { json })).data);
    } catch (reason) {
      setError(toApiError(reason));
    }
  };
  const toggle = (scope: Scope, on: boolean): void =>
    setForm({ ...form, scopes: kScopes.map(([one]) => one).filter((one) => (one === scope ? on : form.scopes.includes(one))) });
  return (
    <Dialog title="New key" onClose={onClose}>
      <form onSubmit={(event) => void submit(event)} noValidate>
        <Field label="Name" fault={tried ? faults.name : undefined}>
          {(props) => <input {...props} autofocus value={form.name} onInput={(event) => setForm({ ...form, name: event.currentTarget.value })} />}
        </Field>
        <fieldset class="field">
          <legend class="field-label">Scopes</legend>
          {kScopes.map(([scope, words]) => (
            <label key={scope} class="check">
              <input type="checkbox" checked={form.scopes.includes(scope)} onChange={(event) => toggle(scope, event.currentTarget.checked)} />
              <span>{scope} <span class="quiet">{words}</span></span>
            </label>
          ))}
          {tried && faults.scopes !== undefined && <p class="fault" role="alert">{faults.scopes}</p>}
        </fieldset>
        <Field label="Maps" hint="Names separated by commas; * stands for any text: town, depot-*. Empty: all maps." fault={tried ? faults.maps : undefined}>
          {(props) => <input {...props} value={form.maps} onInput={(event) => setForm({ ...form, maps: event.currentTarget.value })} />}
        </Field>
        <Field label="Expires after [days]" hint="Empty: never." fault={tried ? faults.days : undefined}>
          {(props) => <input {...props} inputMode="numeric" value={form.days} onInput={(event) => setForm({ ...form, days: event.currentTarget.value })} />}
        </Field>
        {error !== undefined && <Trouble error={error} />}
        <div class="actions">
          <span class="grow" />
          <button type="button" onClick={onClose}>Cancel</button>
          <button type="submit" class="primary">Create the key</button>
        </div>
      </form>
    </Dialog>
  );
}

function Made({ made, onClose }: { made: Schema<'CreatedKey'>; onClose: () => void }) {
  return (
    <Dialog title={`The key “${made.name}”`} onClose={onClose}>
      <p>Copy the key now: it is shown only once. The server stores only its hash.</p>
      <code class="secret" data-secret>{made.key}</code>
      <div class="actions">
        <CopyButton text={made.key} label="Copy the key" />
        <span class="grow" />
        <button type="button" class="primary" onClick={onClose}>Done</button>
      </div>
    </Dialog>
  );
}

import { useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { toApiError, type ApiError } from '../api/errors.js';
import { go, linkTo } from '../state/router.js';
import { Dialog } from '../ui/dialog.js';
import { forget, useKept } from '../ui/kept.js';
import { say } from '../ui/notices.js';
import { Field, Trouble } from '../ui/parts.js';
import { faultOfName } from '../upload/names.js';

/** Creates a map without versions. */
export function NewMapDialog({ onClose }: { onClose: () => void }) {
  const [name, setName] = useKept('new_map', '');
  const [tried, setTried] = useState(false);
  const [error, setError] = useState<ApiError>();
  const fault = tried ? faultOfName(name) : undefined;
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    setTried(true);
    setError(undefined);
    if (faultOfName(name) !== undefined) return;
    try {
      const { status } = await ask('put', '/v1/maps/{map}', { path: { map: name } });
      say({ kind: 'good', text: status === 201 ? `Created ${name}.` : `${name} exists already.` });
      forget('new_map');
      onClose();
      go(linkTo('maps', [name]));
    } catch (reason) {
      setError(toApiError(reason));
    }
  };
  return (
    <Dialog title="New map" onClose={onClose}>
      <form onSubmit={(event) => void submit(event)} noValidate>
        <Field label="Name" fault={fault} hint="Versions are added later: by upload, or by a rebuild from drives.">
          {(props) => <input {...props} autofocus value={name} onInput={(event) => setName(event.currentTarget.value)} />}
        </Field>
        {error !== undefined && <Trouble error={error} />}
        <div class="actions">
          <span class="grow" />
          <button type="button" onClick={onClose}>Cancel</button>
          <button type="submit" class="primary">Create</button>
        </div>
      </form>
    </Dialog>
  );
}

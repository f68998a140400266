import { useState } from 'preact/hooks';
import { answerKey, key, keyWanted, setKey, type KeyReason } from '../api/keys.js';
import { Dialog } from './dialog.js';
import { Field } from './parts.js';
import { useStore } from '../state/store.js';

const kWords: Record<KeyReason, string> = {
  MissingKey: 'This server asks for an API key. What you were doing goes on once it has one.',
  RefusedKey: 'The server does not accept this key: it is unknown, revoked or expired. What you were doing goes on with another one.',
  Chosen: 'Requests carry this key from now on.',
};

/** Asks for the API key when a request needs one. */
export function KeyDialog() {
  const reason = useStore(keyWanted);
  return reason === undefined ? null : <OpenKeyDialog reason={reason} />;
}

function OpenKeyDialog({ reason }: { reason: KeyReason }) {
  const [text, setText] = useState('');
  const [fault, setFault] = useState<string>();
  const current = useStore(key);
  const submit = (event: Event): void => {
    event.preventDefault();
    const given = text.trim();
    // The server's keys are letters, digits, `_` and `-`: anything else could not even travel in a header.
    if (/^[\w.~+/=-]+$/.test(given)) answerKey(given);
    else setFault(given === '' ? 'Paste the key here.' : 'A key has letters, digits, _ and - only.');
  };
  const forgetKey = (): void => {
    setKey(undefined);
    answerKey(undefined);
  };
  return (
    <Dialog title="API key" onClose={() => answerKey(undefined)}>
      <form onSubmit={submit} noValidate>
        <p>{kWords[reason] ?? kWords.RefusedKey}</p>
        <Field label="Key" fault={fault} hint="Kept until this tab is closed, and sent to this server only.">
          {(props) => (
            <input
              {...props} type="password" autocomplete="off" spellcheck={false} autofocus value={text}
              placeholder="stillmap_…" onInput={(event) => setText(event.currentTarget.value)}
            />
          )}
        </Field>
        <div class="actions">
          {current !== undefined && <button type="button" onClick={forgetKey}>Forget the key</button>}
          <span class="grow" />
          <button type="button" onClick={() => answerKey(undefined)}>Cancel</button>
          <button type="submit" class="primary">Use this key</button>
        </div>
      </form>
    </Dialog>
  );
}

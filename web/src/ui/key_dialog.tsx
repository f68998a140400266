import { useState } from 'preact/hooks';
import { answerKey, key, keyWanted, setKey, type KeyReason } from '../api/keys.js';
import { Dialog } from './dialog.js';
import { Field } from './parts.js';
import { useStore } from '../state/store.js';

const kWords: Record<KeyReason, string> = {
  MissingKey: 'This server needs an API key. Enter one to continue.',
  RefusedKey: 'The server does not accept this key: it is unknown, revoked or expired. Enter another key to continue.',
  Chosen: 'The page sends this key with every request.',
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
    // The server's keys have letters, digits, `_` and `-` only. Other characters cannot be sent in a header.
    if (/^[\w.~+/=-]+$/.test(given)) answerKey(given);
    else setFault(given === '' ? 'Paste the key here.' : 'This is not a key: a key has letters, digits, _ and - only. Copy it again.');
  };
  const forgetKey = (): void => {
    setKey(undefined);
    answerKey(undefined);
  };
  return (
    <Dialog title="API key" onClose={() => answerKey(undefined)}>
      <form onSubmit={submit} noValidate>
        <p>{kWords[reason] ?? kWords.RefusedKey}</p>
        <Field label="Key" fault={fault} hint="Kept until this tab is closed. Sent to this server only.">
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

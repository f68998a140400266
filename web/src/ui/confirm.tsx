import type { ComponentChildren } from 'preact';
import { useState } from 'preact/hooks';
import { isAborted, toApiError, type ApiError } from '../api/errors.js';
import { Dialog } from './dialog.js';
import { Field, Trouble } from './parts.js';

export interface ConfirmProps {
  title: string;
  children: ComponentChildren;
  /** What the button says. */
  verb: string;
  danger?: boolean;
  /** Must be typed before the button can be pressed. */
  word?: string;
  /** Done when the button is pressed; the dialog closes after it, and shows why when it throws. */
  act: () => Promise<void>;
  onClose: () => void;
  /** What to show of an error in place of the usual. */
  explain?: (error: ApiError) => ComponentChildren;
}

/** Asks before something is done, and stays open with the reason when that fails. */
export function Confirm({ title, children, verb, danger, word, act, onClose, explain }: ConfirmProps) {
  const [typed, setTyped] = useState('');
  const [error, setError] = useState<ApiError>();
  const [busy, setBusy] = useState(false);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    setBusy(true);
    setError(undefined);
    try {
      await act();
      onClose();
    } catch (reason) {
      if (!isAborted(reason)) setError(toApiError(reason));
    } finally {
      setBusy(false);
    }
  };
  const ready = !busy && (word === undefined || typed.trim() === word);
  return (
    <Dialog title={title} onClose={onClose}>
      <form onSubmit={(event) => void submit(event)}>
        {children}
        {word !== undefined && (
          <Field label={`Type “${word}” to go on`}>
            {(props) => (
              <input {...props} autocomplete="off" spellcheck={false} value={typed} onInput={(event) => setTyped(event.currentTarget.value)} />
            )}
          </Field>
        )}
        {error !== undefined && (explain?.(error) ?? <Trouble error={error} />)}
        <div class="actions">
          <span class="grow" />
          <button type="button" onClick={onClose}>Cancel</button>
          <button type="submit" class={danger === true ? 'danger' : 'primary'} disabled={!ready}>{busy ? 'One moment…' : verb}</button>
        </div>
      </form>
    </Dialog>
  );
}

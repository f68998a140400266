import type { ComponentChildren } from 'preact';
import { useState } from 'preact/hooks';
import { isAborted, toApiError, type ApiError } from '../api/errors.js';
import { Dialog } from './dialog.js';
import { Field, Trouble } from './parts.js';

export interface ConfirmProps {
  title: string;
  children: ComponentChildren;
  /** The text of the button. */
  verb: string;
  danger?: boolean;
  /** Must be typed before the button can be pressed. */
  word?: string;
  /** Whether the button can be pressed; it can if this is left out. */
  ready?: boolean;
  /** Called when the button is pressed. The dialog closes after it, unless it returns false or throws an error, which is shown. */
  act: () => Promise<boolean | void>;
  onClose: () => void;
  /** Shown for an error instead of the usual text. */
  explain?: (error: ApiError) => ComponentChildren;
}

/** Asks before something is done. If that fails, the dialog stays open and shows why. */
export function Confirm({ title, children, verb, danger, word, ready = true, act, onClose, explain }: ConfirmProps) {
  const [typed, setTyped] = useState('');
  const [error, setError] = useState<ApiError>();
  const [busy, setBusy] = useState(false);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    setBusy(true);
    setError(undefined);
    try {
      if (await act() !== false) onClose();
    } catch (reason) {
      if (!isAborted(reason)) setError(toApiError(reason));
    } finally {
      setBusy(false);
    }
  };
  const canPress = ready && !busy && (word === undefined || typed.trim() === word);
  return (
    <Dialog title={title} onClose={onClose}>
      <form onSubmit={(event) => void submit(event)}>
        {children}
        {word !== undefined && (
          <Field label={`Type “${word}” to confirm`}>
            {(props) => (
              <input {...props} autocomplete="off" spellcheck={false} value={typed} onInput={(event) => setTyped(event.currentTarget.value)} />
            )}
          </Field>
        )}
        {error !== undefined && (explain?.(error) ?? <Trouble error={error} />)}
        <div class="actions">
          <span class="grow" />
          <button type="button" onClick={onClose}>Cancel</button>
          <button type="submit" class={danger === true ? 'danger' : 'primary'} disabled={!canPress}>{busy ? 'Please wait…' : verb}</button>
        </div>
      </form>
    </Dialog>
  );
}

// Small components that every view uses.

import type { ComponentChildren } from 'preact';
import { useEffect, useId, useRef, useState } from 'preact/hooks';
import type { ApiError } from '../api/errors.js';
import { askForKey, key } from '../api/keys.js';
import { Icon } from './icon.js';

/**
 * An error as text, with what the server found and expected, and the request's id for the log. If a key is missing, the
 * person can enter one; then the request is tried again.
 */
export function Trouble({ error, onRetry, title }: { error: ApiError; onRetry?: (() => void) | undefined; title?: string | undefined }) {
  const retry = useRef(onRetry);
  retry.current = onRetry;
  useEffect(() => (error.trouble === 'key' ? key.listen(() => retry.current?.()) : undefined), [error]);
  return (
    <div class="trouble" role="alert">
      <Icon name="warning" />
      <div>
        {title !== undefined && <strong>{title}</strong>}
        <p>{error.message}</p>
        {error.faults.length > 0 && (
          <ul>
            {error.faults.map((fault) => (
              <li key={fault.path}><code>{fault.path}</code>: found {fault.found}, expected {fault.expected}</li>
            ))}
          </ul>
        )}
        {error.requestId !== undefined && <p class="quiet">Request id {error.requestId}</p>}
      </div>
      {error.trouble === 'key' ? <button type="button" onClick={askForKey}>Enter a key</button>
        : onRetry !== undefined && <button type="button" onClick={onRetry}>Try again</button>}
    </div>
  );
}

export interface ProgressProps {
  /** 0 to 1; undefined or null if unknown. */
  value: number | null | undefined;
  label: string;
}

export function Progress({ value, label }: ProgressProps) {
  const known = value === null || value === undefined ? {} : { value };
  return <progress class="progress" max={1} aria-label={label} {...known} />;
}

/** Shown where there is nothing yet. */
export function Empty({ title, children }: { title: string; children?: ComponentChildren }) {
  return (
    <div class="empty">
      <h2>{title}</h2>
      {children}
    </div>
  );
}

export type Tone = 'good' | 'bad' | 'warn' | 'plain' | 'live';

export function Badge({ tone, children }: { tone: Tone; children: ComponentChildren }) {
  return <span class={`badge ${tone}`}>{children}</span>;
}

/** A label above its control. Screen readers read `hint` and `fault` with the control. */
export function Field(
  { label, hint, fault, children }: {
    label: string;
    hint?: string | undefined;
    fault?: string | undefined;
    children: (props: { id: string; 'aria-describedby': string | undefined; 'aria-invalid': boolean }) => ComponentChildren;
  },
) {
  const id = useId();
  const about = hint === undefined && fault === undefined ? undefined : `${id}-about`;
  return (
    <div class="field">
      <label for={id}>{label}</label>
      {children({ id, 'aria-describedby': about, 'aria-invalid': fault !== undefined })}
      {about !== undefined && <p id={about} class={fault === undefined ? 'hint' : 'fault'}>{fault ?? hint}</p>}
    </div>
  );
}

/** Puts a text on the clipboard. */
export function CopyButton({ text, label }: { text: string; label: string }) {
  const [done, setDone] = useState(false);
  const copy = async (): Promise<void> => {
    await navigator.clipboard.writeText(text).catch(() => undefined);
    setDone(true);
    setTimeout(() => setDone(false), 2000);
  };
  return (
    <button type="button" class="small" onClick={() => void copy()}>
      <Icon name={done ? 'check' : 'copy'} /> {done ? 'Copied' : label}
    </button>
  );
}

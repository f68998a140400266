import type { ComponentChildren } from 'preact';

/** A part of the panel under a heading. */
export function Section({ title, children }: { title: string; children: ComponentChildren }) {
  return <section class="viewer-section" aria-label={title}><h2>{title}</h2>{children}</section>;
}

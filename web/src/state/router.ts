// The address after `#` says which view is shown, so that every view can be shared as a link.

import { Store } from './store.js';

export interface Place {
  /** First part, as `maps`; empty at the start page. */
  view: string;
  /** The parts that follow, decoded. */
  path: string[];
  query: URLSearchParams;
}

/** What a view is given: the parts of the address after its name, and the query. */
export type ViewProps = Pick<Place, 'path' | 'query'>;

/** Reads `#/view/town/v1?eye=1,2,3`. Parts with invalid escapes are taken as they are. */
export function parsePlace(hash: string): Place {
  const text = hash.replace(/^#\/?/, '');
  const cut = text.indexOf('?');
  const parts = (cut < 0 ? text : text.slice(0, cut)).split('/').filter((part) => part !== '').map(decoded);
  return { view: parts[0] ?? '', path: parts.slice(1), query: new URLSearchParams(cut < 0 ? '' : text.slice(cut + 1)) };
}

/** The address of a view, for `href`: `linkTo('view', ['town', 'v1'])`. */
export function linkTo(view: string, path: readonly string[] = [], query: Record<string, string> = {}): string {
  const parts = [view, ...path].map(encodeURIComponent).join('/');
  const search = new URLSearchParams(query).toString();
  return `#/${parts}${search === '' ? '' : `?${search}`}`;
}

function decoded(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

const kRewriteMs = 120;

export const place = new Store<Place>(parsePlace(globalThis.location?.hash ?? ''));

/** Goes there; the browser's back button returns. */
export function go(link: string): void {
  window.location.hash = link;
}

let rewriting: ReturnType<typeof setTimeout> | undefined;

/**
 * Replaces the query of the present address without a step in the history, for views that keep their state in it. Of
 * several calls within a moment the last is written: browsers refuse to change the address as often as a drag does.
 */
export function replaceQuery(query: Record<string, string>): void {
  const { view, path } = place.get();
  clearTimeout(rewriting);
  rewriting = setTimeout(() => {
    // The window may already be at another address, before `hashchange` is sent: that address must stay.
    const there = parsePlace(window.location.hash);
    if (linkTo(there.view, there.path) === linkTo(view, path)) window.history.replaceState(null, '', linkTo(view, path, query));
  }, kRewriteMs);
}

/** Replaces the address without a step in the history and without drawing the view again. */
export function rewriteAddress(link: string): void {
  window.history.replaceState(null, '', link);
}

/** Starts to follow the address. */
export function startRouter(): void {
  window.addEventListener('hashchange', () => {
    clearTimeout(rewriting);
    place.set(parsePlace(window.location.hash));
  });
}

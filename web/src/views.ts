import type { ComponentType } from 'preact';
import JobsView from './jobs/index.js';
import KeysView from './keys/index.js';
import MapsView from './maps/index.js';
import type { ViewProps } from './state/router.js';

export type ViewComponent = ComponentType<ViewProps>;

export interface View {
  title: string;
  /** Fills the window below the header, without margins and scrolling. */
  whole?: boolean;
  /** The component, or how to load the script that has it. */
  show: ViewComponent | { fetch: () => Promise<{ default: ViewComponent }> };
}

/**
 * Every view by the first part of its address. Lists and forms are part of the page's first script, so that they still
 * work when the server is down. Large views are scripts of their own, loaded when first opened.
 */
export const kViews: Readonly<Record<string, View>> = {
  maps: { title: 'Maps', show: MapsView },
  jobs: { title: 'Jobs', show: JobsView },
  view: { title: 'Map', whole: true, show: { fetch: () => import('./view/index.js') } },
  compare: { title: 'Compare', whole: true, show: { fetch: () => import('./compare/index.js') } },
  localize: { title: 'Localization', whole: true, show: { fetch: () => import('./localize/index.js') } },
  keys: { title: 'Keys', show: KeysView },
  api: { title: 'API', show: { fetch: () => import('./apipage/index.js') } },
};

/** The views in the header, in order. */
export const kMainViews = ['maps', 'jobs', 'keys', 'api'] as const;

import 'swagger-ui-dist/swagger-ui.css';
import { useEffect, useRef } from 'preact/hooks';
import SwaggerUI from 'swagger-ui-dist/swagger-ui-es-bundle.js';
import { key } from '../api/keys.js';
import { useStore } from '../state/store.js';
import { theme } from '../ui/theme.js';
import { withScopes, type Contract } from './contract.js';

interface Props {
  contract: Contract;
  /** The operation to open and scroll to. */
  shown: { tag: string; id: string } | undefined;
  /** Called with the name of each operation that the person opens. */
  onOpen: (id: string) => void;
}

/** What the plugins below use of Swagger UI's own objects; those of Immutable.js. */
interface Tagged {
  get: (name: string) => Operations;
  set: (name: string, value: Operations) => Tagged;
}
interface Operations {
  size: number;
  filter: (keep: (operation: { get: (name: string) => string; getIn: (path: string[]) => string | undefined }) => boolean) => Operations;
}
interface TagList {
  map: (change: (tag: Tagged) => Tagged) => TagList;
  filter: (keep: (tag: Tagged) => boolean) => TagList;
}

/** The contract as Swagger UI draws it: every operation with its parameters, schemas and answers. */
export function Swagger({ contract, shown, onOpen }: Props) {
  const place = useRef<HTMLDivElement>(null);
  const opened = useRef(onOpen);
  opened.current = onOpen;
  const colours = useStore(theme);
  useEffect(() => {
    document.documentElement.classList.toggle('dark-mode', colours === 'dark');
    return () => document.documentElement.classList.remove('dark-mode');
  }, [colours]);
  useEffect(() => {
    SwaggerUI({
      spec: withScopes(contract),
      domNode: place.current,
      filter: true,
      tryItOutEnabled: true,
      displayRequestDuration: true,
      requestInterceptor: withKey,
      plugins: [withoutItsOwnHead, filterByWords, tryOnlyWhatIsSafe, tellsWhatOpens((id) => opened.current(id))],
    });
  }, [contract]);
  useEffect(() => (shown === undefined ? undefined : revealOnceDrawn(shown)), [shown?.id]);
  return <div ref={place} class="swagger" />;
}

/** Opens an operation and scrolls to it, after Swagger UI has drawn it. @return stops waiting for that. */
function revealOnceDrawn({ tag, id }: { tag: string; id: string }): () => void {
  let frame = 0;
  const look = (): void => {
    const operation = document.getElementById(`operations-${tag}-${id}`);
    if (operation === null) {
      frame = requestAnimationFrame(look);
      return;
    }
    const summary = operation.querySelector<HTMLButtonElement>('button.opblock-summary-control');
    if (summary?.getAttribute('aria-expanded') === 'false') summary.click();
    operation.scrollIntoView({ block: 'start' });
  };
  look();
  return () => cancelAnimationFrame(frame);
}

/** Requests carry the page's key. */
function withKey(request: { headers: Record<string, string> }): object {
  const now = key.get();
  if (now !== undefined) request.headers['Authorization'] = `Bearer ${now}`;
  return request;
}

const nothing = () => () => null;

/** The page has a heading and a key of its own, and asks its own server only. */
const withoutItsOwnHead = {
  wrapComponents: { ServersContainer: nothing, authorizeBtn: nothing, authorizeOperationBtn: nothing, TryItOutButton: nothing },
};

/** The filter looks at paths and summaries; Swagger UI's own looks at tags only. */
const filterByWords = {
  fn: {
    opsFilter: (tags: TagList, words: string): TagList => {
      const wanted = words.trim().toLowerCase();
      const matches = (text: string | undefined): boolean => text?.toLowerCase().includes(wanted) === true;
      return tags
        .map((tag) => tag.set('operations', tag.get('operations').filter((one) =>
          matches(`${one.get('method')} ${one.get('path')}`) || matches(one.getIn(['operation', 'summary'])))))
        .filter((tag) => tag.get('operations').size > 0);
    },
  },
};

/** Only requests that change nothing can be sent from here, and no stream, which does not end. */
const tryOnlyWhatIsSafe = {
  statePlugins: {
    spec: { wrapSelectors: { allowTryItOutFor: () => (_: object, path: string, method: string) => method === 'get' && !path.endsWith('/events') } },
  },
};

const tellsWhatOpens = (tell: (id: string) => void) => ({
  statePlugins: {
    layout: {
      wrapActions: {
        show: (original: (thing: string | string[], isShown: boolean) => object) => (thing: string | string[], isShown: boolean) => {
          if (isShown && Array.isArray(thing) && thing[0] === 'operations' && thing[2] !== undefined) tell(thing[2]);
          return original(thing, isShown);
        },
      },
    },
  },
});

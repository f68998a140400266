import { Component, type ComponentChildren } from 'preact';
import { useEffect, useRef, useState } from 'preact/hooks';
import { connection, unanswered } from './api/connection.js';
import { down, toApiError, type ApiError } from './api/errors.js';
import { Header } from './header.js';
import { place, type ViewProps } from './state/router.js';
import { KeyDialog } from './ui/key_dialog.js';
import { Notices } from './ui/notices.js';
import { Empty, Trouble } from './ui/parts.js';
import { useStore } from './state/store.js';
import { UploadTray } from './upload/tray.js';
import { kViews, type View, type ViewComponent } from './views.js';

/** The page: header, the view of the address, uploads, notices and the key dialog. */
export function App() {
  const { view: name, path, query } = useStore(place);
  const view = kViews[name === '' ? 'maps' : name];
  const main = useRef<HTMLElement>(null);
  const at = `${name}/${path.join('/')}`;
  const first = useRef(true);
  useEffect(() => {
    document.title = view === undefined ? 'stillmap' : `${[...path].reverse().concat(view.title).join(' – ')} – stillmap`;
    // Screen readers and the keyboard start at the new view; not when the page opens.
    if (!first.current) main.current?.focus();
    first.current = false;
  }, [at]);
  return (
    <>
      <a class="skip" href="#main" onClick={(event) => { event.preventDefault(); main.current?.focus(); }}>Skip to the content</a>
      <Header current={name === '' ? 'maps' : name} />
      <main id="main" ref={main} tabIndex={-1} class={view?.whole === true ? 'whole' : 'page'}>
        {view === undefined
          ? <Empty title="This page does not exist"><p><a href="#/maps">All maps</a></p></Empty>
          : <Guard key={name}><Lazy view={view} props={{ path, query }} /></Guard>}
      </main>
      <UploadTray />
      <Notices />
      <KeyDialog />
    </>
  );
}

/** Loads a view's code if needed, then shows the view. */
function Lazy({ view, props }: { view: View; props: ViewProps }) {
  const { show } = view;
  const [found, setFound] = useState<{ of: View; Component: ViewComponent }>();
  const [error, setError] = useState<ApiError>();
  const [turn, setTurn] = useState(0);
  useEffect(() => {
    if (typeof show === 'function') return undefined;
    let wanted = true;
    setError(undefined);
    show.fetch().then(
      (module) => wanted && setFound({ of: view, Component: module.default }),
      () => wanted && setError(notFetched()));
    return () => {
      wanted = false;
    };
  }, [view, turn]);
  useEffect(() => connection.listen(({ state }) => state === 'up' && error !== undefined && setTurn(turn + 1)), [error]);
  if (typeof show === 'function') {
    const Component = show;
    return <Component {...props} />;
  }
  if (error !== undefined) {
    return (
      <div class="page">
        <Trouble error={error} title="This view could not be loaded" onRetry={() => window.location.reload()} />
      </div>
    );
  }
  if (found?.of !== view) return <p class="waiting" role="status">Loading…</p>;
  return <found.Component {...props} />;
}

/** The server is down, or has another version of the page by now. */
function notFetched(): ApiError {
  unanswered();
  return down();
}

/** Catches errors while a view is drawn, so that the rest of the page keeps working. */
class Guard extends Component<{ children: ComponentChildren }, { error?: ApiError }> {
  override componentDidCatch(error: unknown): void {
    console.error(error);
    this.setState({ error: toApiError(error) });
  }

  override render() {
    if (this.state.error === undefined) return this.props.children;
    return (
      <Trouble error={this.state.error} title="This view failed" onRetry={() => window.location.reload()} />
    );
  }
}

import { useEffect, useState } from 'preact/hooks';
import { connection } from './api/connection.js';
import { askForKey, key } from './api/keys.js';
import { linkTo } from './state/router.js';
import { Icon } from './ui/icon.js';
import { useStore } from './state/store.js';
import { chooseTheme, themeChoice, type ThemeChoice } from './ui/theme.js';
import { kMainViews, kViews } from './views.js';

/** The views below a main one are marked in the header as that one. */
const kParent: Record<string, string> = { view: 'maps', compare: 'maps', localize: 'maps' };

export function Header({ current }: { current: string }) {
  const shown = kParent[current] ?? current;
  return (
    <header class="top">
      <a class="brand" href={linkTo('maps')}>
        <img src="./favicon.svg" alt="" width="24" height="24" />
        <span>stillmap</span>
      </a>
      <nav aria-label="Main">
        {kMainViews.map((name) => (
          <a key={name} href={linkTo(name)} aria-current={name === shown ? 'page' : undefined}>{kViews[name]?.title}</a>
        ))}
      </nav>
      <span class="grow" />
      <ConnectionState />
      <KeyState />
      <ThemeChoiceButton />
    </header>
  );
}

function ConnectionState() {
  const now = useStore(connection);
  const [, tick] = useState(0);
  useEffect(() => {
    if (now.state !== 'busy') return undefined;
    const timer = setInterval(() => tick((count) => count + 1), 500);
    return () => clearInterval(timer);
  }, [now]);
  return (
    <p class={`connection ${now.state}`} role="status">
      {now.state === 'down' && 'The server does not answer. Trying again…'}
      {now.state === 'slow' && 'Waiting for the server…'}
      {now.state === 'busy' && <span title={now.words}>The server is busy. Trying again {inSeconds(now.retryAtMs)}</span>}
    </p>
  );
}

function inSeconds(atMs: number): string {
  const seconds = Math.ceil((atMs - Date.now()) / 1000);
  return seconds > 0 ? `in ${seconds} s` : 'now';
}

function KeyState() {
  const has = useStore(key) !== undefined;
  return (
    <button type="button" class="plain" onClick={askForKey}>
      <Icon name="key" /> <span class="label">{has ? 'Key set' : 'No key'}</span>
    </button>
  );
}

const kNextTheme: Record<ThemeChoice, ThemeChoice> = { system: 'dark', dark: 'light', light: 'system' };
const kThemeWords: Record<ThemeChoice, string> = {
  system: 'System colours', dark: 'Dark colours', light: 'Light colours',
};

function ThemeChoiceButton() {
  const choice = useStore(themeChoice);
  const icon = choice === 'system' ? 'system' : choice === 'dark' ? 'moon' : 'sun';
  return (
    <button
      type="button" class="plain" title={kThemeWords[choice]}
      aria-label={`${kThemeWords[choice]}. Switch to: ${kThemeWords[kNextTheme[choice]].toLowerCase()}`}
      onClick={() => chooseTheme(kNextTheme[choice])}
    >
      <Icon name={icon} />
    </button>
  );
}

import { Store } from '../state/store.js';

export type Theme = 'dark' | 'light';
/** The person's choice; `system` follows the operating system. */
export type ThemeChoice = Theme | 'system';

const kSlot = 'stillmap.theme';
const kLight = globalThis.matchMedia?.('(prefers-color-scheme: light)');

export const themeChoice = new Store<ThemeChoice>(kept());
/** The colours in use. */
export const theme = new Store<Theme>('dark');

function kept(): ThemeChoice {
  try {
    const text = globalThis.localStorage?.getItem(kSlot);
    return text === 'dark' || text === 'light' ? text : 'system';
  } catch {
    return 'system';
  }
}

function apply(): void {
  const choice = themeChoice.get();
  const now = choice === 'system' ? (kLight?.matches === true ? 'light' : 'dark') : choice;
  document.documentElement.dataset['theme'] = now;
  theme.set(now);
}

export function chooseTheme(choice: ThemeChoice): void {
  try {
    if (choice === 'system') localStorage.removeItem(kSlot);
    else localStorage.setItem(kSlot, choice);
  } catch {
    // Without storage the choice lasts until the page is closed.
  }
  themeChoice.set(choice);
  apply();
}

/** Sets the colours, and follows the operating system's. */
export function startTheme(): void {
  apply();
  kLight?.addEventListener('change', apply);
}

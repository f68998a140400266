import { render } from 'preact';
import { App } from './app.js';
import { startRouter } from './router.js';
import { startTheme } from './ui/theme.js';

startTheme();
startRouter();
const root = document.getElementById('app');
if (root !== null) {
  root.replaceChildren();
  render(<App />, root);
}

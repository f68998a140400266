import { render } from 'preact';
import './upload/upload.css';
import { App } from './app.js';
import { startWatching } from './jobs/watch.js';
import { startRouter } from './state/router.js';
import { startTheme } from './ui/theme.js';
import { guardUploads } from './upload/manager.js';

startTheme();
startRouter();
startWatching();
guardUploads();
const root = document.getElementById('app');
if (root !== null) {
  root.replaceChildren();
  render(<App />, root);
}

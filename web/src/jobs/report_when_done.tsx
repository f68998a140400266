import { useState } from 'preact/hooks';
import { Icon } from '../ui/icon.js';
import { useStore } from '../state/store.js';
import { canNotify, unwatchJob, watched, watchJob } from './watch.js';

/** Chooses whether the page, and the operating system, notify the person when a job ends. */
export function ReportWhenDone({ id }: { id: number }) {
  const isWatched = useStore(watched).includes(id);
  const [permission, setPermission] = useState(canNotify());
  return (
    <div class="actions report">
      <label class="check">
        <input type="checkbox" checked={isWatched} onChange={(event) => (event.currentTarget.checked ? watchJob : unwatchJob)(id)} />
        <span><Icon name="bell" /> Notify me on this page when it is done</span>
      </label>
      {isWatched && permission === 'default' && (
        <button type="button" class="small" onClick={() => void Notification.requestPermission().then(setPermission)}>
          Also as a system notification
        </button>
      )}
      {isWatched && permission === 'granted' && <span class="quiet">A system notification is shown while this page is in the background.</span>}
      {isWatched && permission === 'denied' && <span class="quiet">The browser blocks notifications of this site. Allow them in its settings to get them.</span>}
    </div>
  );
}

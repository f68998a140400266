import { useState } from 'preact/hooks';
import { Icon } from '../ui/icon.js';
import { useStore } from '../state/store.js';
import { canNotify, unwatchJob, watched, watchJob } from './watch.js';

/** Lets the person be told when a job ends: on the page, and by the system if they ask for that. */
export function ReportWhenDone({ id }: { id: number }) {
  const isWatched = useStore(watched).includes(id);
  const [permission, setPermission] = useState(canNotify());
  return (
    <div class="actions report">
      <label class="check">
        <input type="checkbox" checked={isWatched} onChange={(event) => (event.currentTarget.checked ? watchJob : unwatchJob)(id)} />
        <span><Icon name="bell" /> Report on this page when it is done</span>
      </label>
      {isWatched && permission === 'default' && (
        <button type="button" class="small" onClick={() => void Notification.requestPermission().then(setPermission)}>
          Also as a notification of the system
        </button>
      )}
      {isWatched && permission === 'granted' && <span class="quiet">Also as a notification while this page is in the background.</span>}
      {isWatched && permission === 'denied' && <span class="quiet">The browser was told not to show notifications of this site.</span>}
    </div>
  );
}

import { Icon } from './icon.js';
import { Store, useStore } from '../state/store.js';

export interface Notice {
  kind: 'good' | 'bad' | 'plain';
  text: string;
  /** Where to see more. */
  link?: { href: string; text: string };
}

const notices = new Store<readonly (Notice & { id: number })[]>([]);
const kStayMs = 8000;
let last = 0;

/** Shows a message at the edge of the window. A bad one stays until it is closed. */
export function say(notice: Notice): void {
  const id = ++last;
  notices.set([...notices.get(), { ...notice, id }]);
  if (notice.kind !== 'bad') setTimeout(() => close(id), kStayMs);
}

function close(id: number): void {
  notices.set(notices.get().filter((notice) => notice.id !== id));
}

export function Notices() {
  const shown = useStore(notices);
  return (
    <div class="notices" role="status" aria-live="polite">
      {shown.map((notice) => (
        <div key={notice.id} class={`notice ${notice.kind}`}>
          <p>
            {notice.text}
            {notice.link !== undefined && <> <a href={notice.link.href}>{notice.link.text}</a></>}
          </p>
          <button type="button" class="plain" aria-label="Close this message" onClick={() => close(notice.id)}>
            <Icon name="close" />
          </button>
        </div>
      ))}
    </div>
  );
}

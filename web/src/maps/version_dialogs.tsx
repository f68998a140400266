import { useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { ApiError } from '../api/errors.js';
import { linkTo } from '../state/router.js';
import { Confirm } from '../ui/confirm.js';
import { say } from '../ui/notices.js';
import { Trouble } from '../ui/parts.js';

export interface VersionDialogProps {
  map: string;
  version: string;
  etag: string | undefined;
  onChange: () => void;
  onClose: () => void;
}

type WithActive = VersionDialogProps & { active: string | undefined };

/** Makes a version the active one. */
export function Publish({ map, version, active, failedJob, etag, onChange, onClose }: WithActive & { failedJob: number | undefined }) {
  const frame = useNewFrame(version, active);
  const act = async (): Promise<void> => {
    await changing(onChange, () => frame.asking(ask('post', '/v1/maps/{map}/versions/{version}/activate', {
      path: { map, version }, query: frame.query, ...ifMatch(etag), timeoutS: 300,
    })));
    say({ kind: 'good', text: `${version} of ${map} is active.` });
  };
  return (
    <Confirm title={`Publish ${version}?`} verb="Publish" act={act} onClose={onClose} explain={frame.explain}>
      <p>
        Vehicles that ask for poses in <strong>{map}</strong> get them in {version} from the next request on
        {active === undefined ? '.' : <>; sessions that are open stay in {active} until they end. You can roll back to {active} at any time.</>}
      </p>
      {failedJob !== undefined && (
        <p class="remark">It did not pass the checks of <a href={linkTo('jobs', [String(failedJob)])}>job {failedJob}</a>.</p>
      )}
      {frame.choice}
    </Confirm>
  );
}

/** Makes the version before the active one again. */
export function RollBack({ map, version, active, etag, onChange, onClose }: WithActive) {
  const frame = useNewFrame(version, active);
  const act = async (): Promise<void> => {
    await changing(onChange, () => frame.asking(ask('post', '/v1/maps/{map}/rollback', {
      path: { map }, query: frame.query, ...ifMatch(etag), timeoutS: 300,
    })));
    say({ kind: 'good', text: `${map} is back at ${version}.` });
  };
  return (
    <Confirm title={`Roll back to ${version}?`} verb="Roll back" act={act} onClose={onClose} explain={frame.explain}>
      <p>Vehicles get poses in {version} again, from the next request on. {active} stays stored.</p>
      {frame.choice}
    </Confirm>
  );
}

export function DeleteVersion({ map, version, onChange, onClose }: VersionDialogProps) {
  const act = async (): Promise<void> => {
    await changing(onChange, () => ask('delete', '/v1/maps/{map}/versions/{version}', { path: { map, version } }));
    say({ kind: 'good', text: `${version} of ${map} is deleted.` });
  };
  return (
    <Confirm title={`Delete ${version}?`} verb="Delete the version" danger word={version} act={act} onClose={onClose}>
      <p>It is removed from the store, and its name is never given to anything else. This cannot be undone; a download beforehand keeps it.</p>
    </Confirm>
  );
}

/** What the server refuses without being told in words that positions may mean other places. */
function useNewFrame(version: string, active: string | undefined) {
  const [refused, setRefused] = useState(false);
  const [meant, setMeant] = useState(false);
  return {
    query: meant ? { new_frame: true } : {},
    /** Remembers such a refusal, so that the choice is shown. */
    asking: async (answer: Promise<unknown>): Promise<void> => {
      try {
        await answer;
      } catch (error) {
        if (error instanceof ApiError && error.code === 'OtherFrame') setRefused(true);
        throw error;
      }
    },
    // The first time the choice says it all.
    explain: (error: ApiError) => (error.code === 'OtherFrame' && !meant ? null : <Trouble error={error} />),
    choice: refused ? (
      <div class="remark" role="alert">
        <p>
          {version} is in another map frame than {active}: the same position may mean another place. Priors, open sessions and
          whatever else keeps positions in this map would point to wrong places.
        </p>
        <label class="check">
          <input type="checkbox" checked={meant} onChange={(event) => setMeant(event.currentTarget.checked)} />
          I know, and those who use this map know
        </label>
      </div>
    ) : null,
  };
}

function ifMatch(etag: string | undefined): { headers: Record<string, string> } | object {
  return etag === undefined ? {} : { headers: { 'If-Match': etag } };
}

/** The lists are asked anew afterwards, also when it was refused because they are old. */
async function changing(onChange: () => void, act: () => Promise<unknown>): Promise<void> {
  try {
    await act();
  } finally {
    onChange();
  }
}

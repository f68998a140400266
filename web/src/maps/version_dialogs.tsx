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
export function Activate({ map, version, active, failedJob, etag, onChange, onClose }: WithActive & { failedJob: number | undefined }) {
  const frame = useNewFrame(version, active);
  const act = async (): Promise<void> => {
    await changing(onChange, () => frame.asking(ask('post', '/v1/maps/{map}/versions/{version}/activate', {
      path: { map, version }, query: frame.query, ...ifMatch(etag), timeoutS: 300,
    })));
    say({ kind: 'good', text: `${version} of ${map} is now active.` });
  };
  return (
    <Confirm title={`Activate ${version}?`} verb="Activate" act={act} onClose={onClose} explain={frame.explain}>
      <p>
        From the next request on, vehicles in <strong>{map}</strong> get their poses in {version}.
        {active !== undefined && <> Open sessions stay in {active} until they end. You can roll back to {active} at any time.</>}
      </p>
      {failedJob !== undefined && (
        <p class="remark">This version did not pass the checks of <a href={linkTo('jobs', [String(failedJob)])}>job {failedJob}</a>.</p>
      )}
      {frame.choice}
    </Confirm>
  );
}

/** Makes the previous version active again. */
export function RollBack({ map, version, active, etag, onChange, onClose }: WithActive) {
  const frame = useNewFrame(version, active);
  const act = async (): Promise<void> => {
    await changing(onChange, () => frame.asking(ask('post', '/v1/maps/{map}/rollback', {
      path: { map }, query: frame.query, ...ifMatch(etag), timeoutS: 300,
    })));
    say({ kind: 'good', text: `${version} of ${map} is active again.` });
  };
  return (
    <Confirm title={`Roll back to ${version}?`} verb="Roll back" act={act} onClose={onClose} explain={frame.explain}>
      <p>From the next request on, vehicles get their poses in {version} again. {active} stays stored.</p>
      {frame.choice}
    </Confirm>
  );
}

export function DeleteVersion({ map, version, onChange, onClose }: VersionDialogProps) {
  const act = async (): Promise<void> => {
    await changing(onChange, () => ask('delete', '/v1/maps/{map}/versions/{version}', { path: { map, version } }));
    say({ kind: 'good', text: `Deleted ${version} of ${map}.` });
  };
  return (
    <Confirm title={`Delete ${version}?`} verb="Delete the version" danger word={version} act={act} onClose={onClose}>
      <p>The version is removed from the store, and its name cannot be used again. You cannot undo this. To keep a copy, download it first.</p>
    </Confirm>
  );
}

/** A change of the map frame: the server refuses it until the person confirms that positions may mean other places. */
function useNewFrame(version: string, active: string | undefined) {
  const [refused, setRefused] = useState(false);
  const [meant, setMeant] = useState(false);
  return {
    query: meant ? { new_frame: true } : {},
    /** Remembers such a refusal, so that the checkbox is shown. */
    asking: async (answer: Promise<unknown>): Promise<void> => {
      try {
        await answer;
      } catch (error) {
        if (error instanceof ApiError && error.code === 'OtherFrame') setRefused(true);
        throw error;
      }
    },
    // The first time, the checkbox explains it.
    explain: (error: ApiError) => (error.code === 'OtherFrame' && !meant ? null : <Trouble error={error} />),
    choice: refused ? (
      <div class="remark" role="alert">
        <p>
          {version} is not known to be in the map frame of {active}: the same position can mean another place. Stored positions in this
          map, such as priors, would then point to wrong places. To avoid this, build {version} again with --register-to.
        </p>
        <label class="check">
          <input type="checkbox" checked={meant} onChange={(event) => setMeant(event.currentTarget.checked)} />
          Use it anyway. The users of this map know about the change.
        </label>
      </div>
    ) : null,
  };
}

function ifMatch(etag: string | undefined): { headers: Record<string, string> } | object {
  return etag === undefined ? {} : { headers: { 'If-Match': etag } };
}

/** Reloads the lists afterwards, also after a refusal: the lists may be out of date. */
async function changing(onChange: () => void, act: () => Promise<unknown>): Promise<void> {
  try {
    await act();
  } finally {
    onChange();
  }
}

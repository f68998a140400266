import { useState } from 'preact/hooks';
import { ask, type Schema } from '../api/client.js';
import { Confirm } from '../ui/confirm.js';
import { age, date, number } from '../ui/format.js';
import { useLoad } from '../ui/load.js';
import { say } from '../ui/notices.js';
import { Badge, Field } from '../ui/parts.js';
import { Activate } from './version_dialogs.js';

type Rollout = Schema<'Rollout'>;
type Counts = Schema<'AnswerCounts'>;

const kNone: Counts = { ok: 0, degraded: 0, lost: 0 };

export interface RolloutProps {
  map: string;
  active: string | undefined;
  etag: string | undefined;
  onChange: () => void;
}

/** The roll-out of a version to some vehicles; nothing if there is none. */
export function RolloutSection({ map, active, etag, onChange }: RolloutProps) {
  const { data, reload } = useLoad(
    async (signal) => (await ask('get', '/v1/maps/{map}/rollout', { path: { map }, signal })).data, [map, active], { everyS: 4 });
  const [open, setOpen] = useState<'change' | 'complete' | 'end'>();
  const version = data?.version;
  if (data === undefined || version === undefined) return null;
  const halted = data.state === 'halted';
  const dialog = { map, onClose: () => setOpen(undefined), onChange: (): void => (reload(), onChange()) };
  return (
    <section aria-labelledby="rollout">
      <div class="heading">
        <h2 id="rollout">Roll-out of {version}</h2>
        {halted ? <Badge tone="bad">Halted</Badge> : <Badge tone="live">Running</Badge>}
        <span class="quiet">{whoGetsIt(data)}</span>
        <span class="grow" />
        <button type="button" onClick={() => setOpen('change')}>{halted ? 'Begin again' : 'Set the share'}</button>
        <button type="button" onClick={() => setOpen('complete')}>Complete</button>
        <button type="button" onClick={() => setOpen('end')}>End</button>
      </div>
      {halted && <p class="remark" role="alert">All vehicles get {data.active_version} again: {data.reason}.</p>}
      {!halted && data.version_state !== 'ready' && (
        <p class="remark">{version} is not loaded ({data.version_state}): until it is, all vehicles get {data.active_version}.</p>
      )}
      <div class="card table-frame">
        <table class="rollout">
          <thead>
            <tr>
              <th scope="col">Answers</th><th scope="col" class="end">Ok</th><th scope="col" class="end">Degraded</th>
              <th scope="col" class="end">Lost</th><th scope="col" class="end">Degraded or lost</th>
            </tr>
          </thead>
          <tbody>
            <Row name={`${version}, begun ${age(data.begun_ns ?? '0')}`} counts={data.answers?.rollout ?? kNone} />
            <Row name={`${data.active_version}, in the same time`} counts={data.answers?.others ?? kNone} />
            <Row name={`${data.active_version}, before`} counts={data.answers?.before ?? kNone} />
          </tbody>
        </table>
      </div>
      {open === 'change' && <RollOut {...dialog} version={version} before={data} />}
      {open === 'complete' && <Activate {...dialog} version={version} active={active} failedJob={undefined} etag={etag} />}
      {open === 'end' && <EndRollout {...dialog} rollout={data} />}
    </section>
  );
}

function Row({ name, counts: { ok, degraded, lost } }: { name: string; counts: Counts }) {
  const all = ok + degraded + lost;
  return (
    <tr>
      <th scope="row" class="name">{name}</th>
      <td class="end number">{number(ok)}</td><td class="end number">{number(degraded)}</td><td class="end number">{number(lost)}</td>
      <td class="end number">{all === 0 ? '–' : `${number((100 * (degraded + lost)) / all, 1)} %`}</td>
    </tr>
  );
}

/** As "10 % of the vehicles, depot-*". */
function whoGetsIt({ share = 0, vehicles = [] }: Rollout): string {
  return [...(share > 0 || vehicles.length === 0 ? [`${number(100 * share)} % of the vehicles`] : []), ...vehicles].join(', ');
}

interface RollOutProps {
  map: string;
  version: string;
  /** The roll-out that is changed. */
  before?: Rollout;
  onChange: () => void;
  onClose: () => void;
}

/** Begins a roll-out, or changes it. */
export function RollOut({ map, version, before, onChange, onClose }: RollOutProps) {
  const [percent, setPercent] = useState(String(100 * (before?.share ?? 0.1)));
  const [labels, setLabels] = useState((before?.vehicles ?? []).join('\n'));
  const share = Number(percent) / 100;
  const act = async (): Promise<void> => {
    const vehicles = labels.split('\n').map((label) => label.trim()).filter((label) => label !== '');
    const json = { version, share, vehicles, ...(before?.halt !== undefined && { halt: before.halt }) };
    await ask('put', '/v1/maps/{map}/rollout', { path: { map }, json });
    say({ kind: 'good', text: `${version} of ${map} is rolled out.` });
    onChange();
  };
  return (
    <Confirm title={`Roll out ${version}`} verb="Roll out" ready={share >= 0 && share <= 1 && percent !== ''} act={act} onClose={onClose}>
      <p>
        Some vehicles get their poses in {version}. If more of their answers are degraded or lost than of the others, the server halts
        the roll-out.
      </p>
      <Field label="Share of the vehicles with a label [%]" hint="A vehicle that gets the version keeps it when the share grows.">
        {(props) => (
          <input {...props} type="number" min={0} max={100} step="any" value={percent} onInput={(event) => setPercent(event.currentTarget.value)} />
        )}
      </Field>
      <Field label="Vehicles that get it anyway" hint="One label a line; * stands for any text.">
        {(props) => <textarea {...props} rows={3} value={labels} onInput={(event) => setLabels(event.currentTarget.value)} />}
      </Field>
    </Confirm>
  );
}

function EndRollout({ map, rollout, onChange, onClose }: { map: string; rollout: Rollout; onChange: () => void; onClose: () => void }) {
  const act = async (): Promise<void> => {
    await ask('delete', '/v1/maps/{map}/rollout', { path: { map } });
    say({ kind: 'good', text: `The roll-out of ${rollout.version} has ended.` });
    onChange();
  };
  return (
    <Confirm title={`End the roll-out of ${rollout.version}?`} verb="End it" act={act} onClose={onClose}>
      <p>From the next request on, all vehicles get their poses in {rollout.active_version}. {rollout.version} stays stored.</p>
    </Confirm>
  );
}

const kVehiclesShown = 1000;

/** Which vehicle asked which version; nothing if none said who it is. */
export function VehiclesSection({ map }: { map: string }) {
  const { data } = useLoad(
    async (signal) => (await ask('get', '/v1/maps/{map}/vehicles', { path: { map }, query: { limit: kVehiclesShown }, signal })).data,
    [map], { everyS: 5 });
  if (data === undefined || data.vehicles.length === 0) return null;
  return (
    <section aria-labelledby="vehicles">
      <div class="heading"><h2 id="vehicles">Vehicles</h2></div>
      <div class="card table-frame">
        <table class="vehicles">
          <thead>
            <tr>
              <th scope="col">Vehicle</th><th scope="col">Version</th><th scope="col">Last seen</th><th scope="col" class="end">Ok</th>
              <th scope="col" class="end">Degraded</th><th scope="col" class="end">Lost</th>
            </tr>
          </thead>
          <tbody>
            {data.vehicles.map(({ label, version, last_seen_ns, answers }) => (
              <tr key={label} data-vehicle={label}>
                <th scope="row" class="name">{label}</th>
                <td>{version}</td>
                <td title={date(last_seen_ns)}>{age(last_seen_ns)}</td>
                <td class="end number">{number(answers.ok)}</td>
                <td class="end number">{number(answers.degraded)}</td>
                <td class="end number">{number(answers.lost)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {data.next !== null && <p class="quiet">These are the first {number(kVehiclesShown)}; the API lists all.</p>}
    </section>
  );
}

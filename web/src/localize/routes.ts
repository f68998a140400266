import { addressOf, ask, versionPath, type Schema } from '../api/client.js';
import { jsonOf, send } from '../api/send.js';
import { answerOf, type Answer } from './answer.js';
import type { SessionRoutes } from './drive_run.js';
import type { Vehicle } from './fleet.js';
import type { Pose } from './pose.js';
import { poseQuery, queryText, type Start } from './request.js';
import type { ScanFile } from './scan_file.js';
import { tilePositions } from './residual.js';

/** Which map, and which of its versions; null is the active one. */
export interface MapPlace {
  map: string;
  version: string | null;
}

/** Standard deviations of a place that a person sets. */
const kShownSigma_m = 2;
const kShownSigma_rad = 0.2;

function localizePath({ map, version }: MapPlace, start: Start, scan: ScanFile): string {
  const base = `${version === null ? addressOf('/v1/maps/{map}', { map }) : versionPath(map, version)}/localize`;
  const query = queryText(poseQuery(start, scan.layout));
  return query === '' ? base : `${base}?${query}`;
}

export interface Asked {
  answer: Answer;
  roundTrip_ms: number;
  /** With its query, to show as a curl line. */
  path: string;
}

/** Asks where a scan was taken. @throws ApiError. */
export async function localize(place: MapPlace, start: Start, scan: ScanFile, signal: AbortSignal): Promise<Asked> {
  const path = localizePath(place, start, scan);
  const begin = performance.now();
  const response = await send('POST', path, { body: scan.body, headers: { 'Content-Type': scan.contentType }, signal });
  const written = (await jsonOf(response, `POST ${path}`)) as Schema<'PoseAnswer'>;
  return { answer: answerOf(written), roundTrip_ms: performance.now() - begin, path };
}

/** A prior with its covariance, as a session needs it. */
function withCovariance(pose: Pose): Schema<'Prior'> {
  const variances = [0, 1, 2].map(() => kShownSigma_m ** 2).concat([0, 1, 2].map(() => kShownSigma_rad ** 2));
  const covariance = Array.from({ length: 36 }, (_, i) => (i % 7 === 0 ? variances[i / 7]! : 0));
  return { ...pose, covariance } as Schema<'Prior'>;
}

/** The routes of one session for the scans of a drive. @param scanAt  reads a scan when its turn comes. */
export function sessionRoutes(
  { map, version }: MapPlace, start: Start, scanAt: (index: number) => Promise<ScanFile>, stamps_ns: readonly string[], signal: AbortSignal,
): SessionRoutes {
  const from = start.kind === 'prior' ? { prior: withCovariance(start.pose) }
    : start.kind === 'gnss' ? { gnss: gnssOf(start) } : {};
  return {
    open: async () => {
      const json = { map, ...(version === null ? {} : { version }), ...from };
      return (await ask('post', '/v1/sessions', { json, signal })).data.id;
    },
    send: async (session, index) => {
      const scan = await scanAt(index);
      const query = new URLSearchParams({ stamp_ns: stamps_ns[index]! });
      if (scan.layout === 'xyz') query.set('layout', 'xyz');
      const path = `/v1/sessions/${encodeURIComponent(session)}/scans?${query}`;
      const response = await send('POST', path, { body: scan.body, headers: { 'Content-Type': scan.contentType }, signal });
      return answerOf((await jsonOf(response, 'POST a scan of the session')) as Schema<'SessionPoseAnswer'>);
    },
    // Without `signal`: the session is closed also after the view was left.
    close: async (session) => void (await ask('delete', '/v1/sessions/{session}', { path: { session } })),
  };
}

function gnssOf(start: Extract<Start, { kind: 'gnss' }>): Schema<'Gnss'> {
  const { latitude_deg, longitude_deg, altitude_m, sigma_m } = start;
  return { latitude_deg, longitude_deg, sigma_m, ...(altitude_m === null ? {} : { altitude_m }) };
}

/** The coordinates of a tile of level 0, relative to its corner [m]. */
export async function tileOf({ map, version }: { map: string; version: string }, x: number, y: number, signal: AbortSignal): Promise<Float32Array> {
  return tilePositions(await (await send('GET', `${versionPath(map, version)}/tiles/0/${x}/${y}`, { signal })).arrayBuffer());
}

/** The vehicles whose sessions this key may see. */
export async function vehicles(signal: AbortSignal): Promise<Vehicle[]> {
  const { data } = await ask('get', '/v1/sessions', { signal, patience: 0 });
  return data.sessions.map((session) => ({
    label: session.label,
    map: session.map.name,
    version: session.map.version,
    status: session.status,
    reasons: session.reasons,
    pose: session.pose as Pose | null,
    covariance: session.covariance,
    scans: session.scans,
    idle_s: session.idle_s,
  }));
}

import type { Pose } from './pose.js';
import type { ScanFile } from './scan_file.js';

/** Where the search starts. */
export type Start =
  | { kind: 'everywhere' }
  | { kind: 'prior'; pose: Pose }
  | { kind: 'gnss'; latitude_deg: number; longitude_deg: number; altitude_m: number | null; sigma_m: number };

/** Digits for millimetres on Earth, and still short to read. */
const number = (value: number, digits: number): string => String(Number(value.toFixed(digits)));

/** Query of a request for a pose: the start, and how raw points lie. */
export function poseQuery(start: Start, layout: ScanFile['layout']): URLSearchParams {
  const query = new URLSearchParams();
  if (start.kind === 'prior') {
    query.set('prior_t', start.pose.position.map((value) => number(value, 3)).join(','));
    query.set('prior_q', start.pose.quaternion.map((value) => number(value, 6)).join(','));
  } else if (start.kind === 'gnss') {
    const altitude = start.altitude_m === null ? '' : number(start.altitude_m, 3);
    query.set('gnss', [number(start.latitude_deg, 9), number(start.longitude_deg, 9), altitude, number(start.sigma_m, 3)].join(','));
  }
  if (layout === 'xyz') query.set('layout', 'xyz');
  return query;
}

/** `a=1,2&b=3`: commas stay readable, all else is escaped. */
export const queryText = (query: URLSearchParams): string => query.toString().replaceAll('%2C', ',');

/** A word that the shell does not change. */
const quoted = (text: string): string => `'${text.replaceAll("'", String.raw`'\''`)}'`;

/**
 * A curl command for the same request. It names the variable of the key, and never contains the key.
 *
 * @param origin  of the page, `https://host`.
 * @param path    of the route, with its query.
 */
export function curlLine(origin: string, path: string, scan: ScanFile, withKey: boolean, rewritten: boolean): string {
  const key = withKey ? ` -H "Authorization: Bearer $STILLMAP_KEY"` : '';
  const note = rewritten ? '# The server does not accept PLY: first save the points as raw float32 x y z.\n' : '';
  const file = rewritten ? scan.name.replace(/\.ply$/i, '.bin') : scan.name;
  return `${note}curl -sS${key} -H 'Content-Type: ${scan.contentType}' --data-binary ${quoted(`@${file}`)} ${quoted(origin + path)}`;
}

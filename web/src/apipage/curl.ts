import { exampleOf, resolve, type ApiDocument, type Parameter, type Route } from './document.js';

/** Whether a route needs a key, once the server has any: its scope; undefined for an open one. */
export function scopeOf({ operation }: Route): string | undefined {
  const scopes = operation.security?.flatMap((one) => Object.values(one).flat()) ?? [];
  return scopes.length === 0 ? undefined : scopes.join(', ');
}

const kFileOf: Record<string, string> = {
  'application/x-tar': 'map.tar', 'application/gzip': 'map.tar.gz', 'application/zstd': 'map.tar.zst',
  'application/vnd.pcd': 'scan.pcd', 'application/ply': 'map.ply', 'application/octet-stream': 'scan.bin',
};

/**
 * A line for a shell that asks the route of this very server.
 *
 * @param values  of path parameters; those without one stand as their name in capitals.
 */
export function curlOf(document: ApiDocument, route: Route, origin: string, values: Record<string, string> = {}): string {
  const parameters = (route.operation.parameters ?? []).map((one) => resolve<Parameter>(document, one)).filter((one) => one !== undefined);
  const path = route.path.replace(/\{(\w+)\}/g, (_, name: string) => values[name] ?? name.toUpperCase());
  const query = parameters.filter((one) => one.in === 'query' && one.required === true).map((one) => `${one.name}=${one.name.toUpperCase()}`);
  const url = `${origin}${path}${query.length === 0 ? '' : `?${query.join('&')}`}`;
  const words = ['curl -s'];
  if (route.method !== 'GET') words.push(`-X ${route.method}`);
  if (scopeOf(route) !== undefined) words.push('-H "Authorization: Bearer $KEY"');
  words.push(...bodyOf(document, route), /[?&]/.test(url) ? `'${url}'` : url);
  return words.join(' ');
}

function bodyOf(document: ApiDocument, { operation }: Route): string[] {
  const content = operation.requestBody?.content;
  if (content === undefined) return [];
  const json = content['application/json'];
  if (json !== undefined && content['application/octet-stream'] === undefined) {
    return ["-H 'Content-Type: application/json'", `-d '${JSON.stringify(exampleOf(document, json.schema))}'`];
  }
  const type = Object.keys(content).find((one) => kFileOf[one] !== undefined);
  return type === undefined ? [] : [`-H 'Content-Type: ${type}'`, `--data-binary @${kFileOf[type]}`];
}

// The server's routes with their types, which `npm run schema` makes from server/openapi.json.

import type { components, paths } from './schema.js';
import { jsonOf, send, type SendOptions } from './send.js';

/** A named schema of the server's OpenAPI document. */
export type Schema<Name extends keyof components['schemas']> = components['schemas'][Name];

type Method = 'get' | 'put' | 'post' | 'delete';
type Operation<Route extends keyof paths, Verb extends Method> = Exclude<paths[Route][Verb & keyof paths[Route]], undefined>;
/** Routes that have a method. */
export type RouteOf<Verb extends Method> = {
  [Route in keyof paths]: [Operation<Route, Verb>] extends [never] ? never : Route;
}[keyof paths];

type JsonOf<Response> = Response extends { content: { 'application/json': infer Body } } ? Body : undefined;
type Success<Answers> = { [Status in keyof Answers & (200 | 201 | 202 | 204)]: JsonOf<Answers[Status]> }[
  keyof Answers & (200 | 201 | 202 | 204)
];
/** The JSON of a route's successful answer; undefined if it has none. */
export type AnswerOf<Route extends keyof paths, Verb extends Method> =
  Operation<Route, Verb> extends { responses: infer Answers } ? Success<Answers> : never;

type Given<Parameters, In extends string> = In extends keyof Parameters ? Exclude<Parameters[In], undefined> : never;
type QueryOf<Op> = Op extends { parameters: infer Parameters } ? Given<Parameters, 'query'> : never;
type BodyOf<Op> = Op extends { requestBody?: infer Request }
  ? Exclude<Request, undefined> extends { content: { 'application/json': infer Body } } ? Body : never
  : never;

export interface Ask<Op> extends SendOptions {
  /** Values of the route's `{names}`. */
  path?: Record<string, string | number>;
  query?: [QueryOf<Op>] extends [never] ? undefined : QueryOf<Op>;
  /** Sent as JSON. */
  json?: [BodyOf<Op>] extends [never] ? undefined : BodyOf<Op>;
}

export interface Answer<Data> {
  data: Data;
  status: number;
  etag: string | undefined;
  location: string | undefined;
}

/**
 * Asks one route of the server: `ask('get', '/v1/maps/{map}', { path: { map: 'town' } })`.
 *
 * @throws ApiError; AbortError when `signal` fires.
 */
export async function ask<Verb extends Method, Route extends RouteOf<Verb>>(
  method: Verb, route: Route, options: Ask<Operation<Route, Verb>> = {},
): Promise<Answer<AnswerOf<Route, Verb>>> {
  const url = addressOf(route, options.path ?? {}, options.query as Record<string, unknown> | undefined);
  const body = options.json === undefined ? options.body : JSON.stringify(options.json);
  const headers = { ...(options.json === undefined ? {} : { 'Content-Type': 'application/json' }), ...options.headers };
  const response = await send(method.toUpperCase(), url, { ...options, headers, ...(body === undefined ? {} : { body }) });
  const isJson = (response.headers.get('content-type') ?? '').includes('json') && response.status !== 204;
  const data = isJson ? await jsonOf(response, `${method.toUpperCase()} ${url}`) : undefined;
  return {
    data: data as AnswerOf<Route, Verb>,
    status: response.status,
    etag: response.headers.get('etag') ?? undefined,
    location: response.headers.get('location') ?? undefined,
  };
}

/** The start of a version's routes: for answers that are not JSON, and for libraries that send requests themselves. */
export function versionPath(map: string, version: string): string {
  return addressOf('/v1/maps/{map}/versions/{version}', { map, version });
}

/** `route` with its `{names}` and query filled in. @throws Error when a name has no value: a fault of the page. */
export function addressOf(
  route: string, path: Record<string, string | number>, query: Record<string, unknown> = {},
): string {
  const filled = route.replace(/\{(\w+)\}/g, (_, name: string) => {
    const value = path[name];
    if (value === undefined) throw new Error(`${route}: no value for {${name}}`);
    return encodeURIComponent(value);
  });
  const given = Object.entries(query).filter(([, value]) => value !== undefined && value !== '');
  if (given.length === 0) return filled;
  return `${filled}?${new URLSearchParams(given.map(([name, value]) => [name, String(value)]))}`;
}

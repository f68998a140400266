// The server's OpenAPI document as the page reads it: only what it shows, and nothing taken for granted.

export interface ApiDocument {
  info?: { title?: string; version?: string; summary?: string; description?: string };
  tags?: { name: string; description?: string }[];
  paths?: Record<string, Record<string, Operation>>;
  components?: Record<string, Record<string, unknown>>;
}

export interface Operation {
  operationId?: string;
  tags?: string[];
  summary?: string;
  description?: string;
  security?: Record<string, string[]>[];
  parameters?: (Parameter | Reference)[];
  requestBody?: { required?: boolean; content?: Record<string, { schema?: Schema }> };
  responses?: Record<string, ApiResponse | Reference>;
}

export interface Reference {
  $ref: string;
}

export interface Parameter {
  name: string;
  in: string;
  required?: boolean;
  description?: string;
  schema?: Schema;
}

export interface ApiResponse {
  description?: string;
  content?: Record<string, { schema?: Schema }>;
}

export interface Schema {
  $ref?: string;
  type?: string | string[];
  description?: string;
  properties?: Record<string, Schema>;
  required?: string[];
  items?: Schema;
  enum?: unknown[];
  const?: unknown;
  oneOf?: Schema[];
  anyOf?: Schema[];
  allOf?: Schema[];
  additionalProperties?: Schema | boolean;
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  minLength?: number;
  maxLength?: number;
  minItems?: number;
  maxItems?: number;
  pattern?: string;
  default?: unknown;
  format?: string;
}

export interface Route {
  id: string;
  method: string;
  path: string;
  operation: Operation;
}

/** The routes by tag, in the document's order of tags; those without a known tag at the end. */
export function routesByTag(document: ApiDocument): { name: string; description: string; routes: Route[] }[] {
  const all = Object.entries(document.paths ?? {}).flatMap(([path, methods]) =>
    Object.entries(methods).map(([method, operation]): Route => ({
      id: operation.operationId ?? `${method}${path}`, method: method.toUpperCase(), path, operation,
    })));
  const known = document.tags ?? [];
  const rest = all.filter(({ operation }) => !known.some(({ name }) => operation.tags?.includes(name)));
  return [
    ...known.map(({ name, description }) => ({
      name, description: description ?? '', routes: all.filter(({ operation }) => operation.tags?.includes(name)),
    })),
    ...(rest.length > 0 ? [{ name: 'other', description: '', routes: rest }] : []),
  ].filter(({ routes }) => routes.length > 0);
}

/** What a `$ref` within the document names; undefined when there is no such thing. */
export function resolve<Thing>(document: ApiDocument, thing: Thing | Reference | undefined): Thing | undefined {
  if (thing === undefined || typeof thing !== 'object' || thing === null || !('$ref' in thing)) return thing as Thing | undefined;
  const parts = (thing as Reference).$ref.replace(/^#\//, '').split('/');
  return parts.reduce<unknown>((at, part) => (at as Record<string, unknown> | undefined)?.[part], document) as Thing | undefined;
}

export function nameOfRef(ref: string): string {
  return ref.split('/').at(-1) ?? ref;
}

/** "number >= 0, <= 1", "array of Pose", "one of ok, lost". */
export function typeWords(schema: Schema | undefined): string {
  if (schema === undefined) return '';
  if (schema.$ref !== undefined) return nameOfRef(schema.$ref);
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  const choice = schema.oneOf ?? schema.anyOf;
  if (choice !== undefined) return choice.map(typeWords).join(' or ');
  if (schema.allOf !== undefined) return schema.allOf.map(typeWords).filter(Boolean).join(' and ');
  if (schema.enum !== undefined) return `one of ${schema.enum.map(String).join(', ')}`;
  const type = Array.isArray(schema.type) ? schema.type.join(' or ') : schema.type ?? (schema.properties === undefined ? 'bytes' : 'object');
  const of = schema.items === undefined ? '' : ` of ${typeWords(schema.items)}`;
  return [type + of, ...boundsOf(schema)].join(', ');
}

function boundsOf(schema: Schema): string[] {
  const between = (low: number | undefined, high: number | undefined, what: string): string[] => {
    if (low !== undefined && low === high) return [`${low}${what}`];
    return [...(low === undefined ? [] : [`>= ${low}${what}`]), ...(high === undefined ? [] : [`<= ${high}${what}`])];
  };
  return [
    ...between(schema.minimum, schema.maximum, ''),
    ...(schema.exclusiveMinimum === undefined ? [] : [`> ${schema.exclusiveMinimum}`]),
    ...between(schema.minItems, schema.maxItems, ' items'),
    ...between(schema.minLength, schema.maxLength, ' letters'),
    ...(schema.default === undefined ? [] : [`default ${JSON.stringify(schema.default)}`]),
  ];
}

/** A value that a schema takes, as far as it tells; for an example. */
export function exampleOf(document: ApiDocument, schema: Schema | undefined, depth = 0): unknown {
  const known = resolve<Schema>(document, schema);
  if (known === undefined || depth > 6) return null;
  if (known.const !== undefined) return known.const;
  if (known.default !== undefined) return known.default;
  if (known.enum !== undefined) return known.enum[0];
  const choice = known.oneOf ?? known.anyOf ?? known.allOf;
  if (choice !== undefined && known.properties === undefined) return exampleOf(document, choice[0], depth + 1);
  const type = Array.isArray(known.type) ? known.type[0] : known.type;
  if (type === 'object' || known.properties !== undefined) {
    const wanted = Object.entries(known.properties ?? {}).filter(([name]) => known.required?.includes(name));
    return Object.fromEntries(wanted.map(([name, property]) => [name, exampleOf(document, property, depth + 1)]));
  }
  if (type === 'array') {
    const count = Math.min(known.minItems ?? 1, 6);
    return Array.from({ length: count }, () => exampleOf(document, known.items, depth + 1));
  }
  if (type === 'integer' || type === 'number') return Math.max(known.minimum ?? 0, 0);
  if (type === 'boolean') return false;
  return known.pattern?.includes('[0-9]+$') === true ? '0' : 'text';
}

import { ask, type Answer, type Schema } from '../api/client.js';
import { ApiError } from '../api/errors.js';
import type { Box } from '../scene/clip_box.js';
import type { Decision } from '../scene/object_colours.js';
import type { SeenObject } from '../scene/seen_objects.js';
import type { Vec3 } from '../scene/types.js';

/** A correction for the next rebuild: of an object, by its class and position, or of a region. */
export interface Edit {
  readonly action: Decision;
  readonly object?: { readonly centre: Vec3; readonly class: string };
  readonly box?: Box;
  readonly note?: string;
}

type EditDocument = Schema<'Edits'>;

/** How far [m] an object may be from its position at the correction. */
const kSamePlaceM = 1;

/** The edits, with the one of an object replaced or removed. */
export function decide(edits: readonly Edit[], object: SeenObject, decision: Decision | undefined): Edit[] {
  const others = edits.filter((edit) => !isAbout(edit, object));
  if (decision === undefined) return others;
  const place = object.places[Math.floor(object.places.length / 2)] as Box;
  return [...others, { action: decision, object: { centre: place.centre, class: object.class } }];
}

/** The decisions, by number of the object. */
export function decisionsOf(edits: readonly Edit[], objects: readonly SeenObject[]): Map<number, Decision> {
  const found = new Map<number, Decision>();
  for (const edit of edits) {
    for (const object of objects) if (isAbout(edit, object)) found.set(object.number, edit.action);
  }
  return found;
}

function isAbout({ object: said }: Edit, object: SeenObject): boolean {
  return said !== undefined && said.class === object.class && object.places.some(({ centre }) =>
    Math.hypot(centre[0] - said.centre[0], centre[1] - said.centre[1], centre[2] - said.centre[2]) < kSamePlaceM);
}

/** The corrections of a map, which the server stores. */
export class Corrections {
  private etag_: string | undefined;
  edits: readonly Edit[] = [];

  constructor(private readonly map_: string) {}

  async load(signal?: AbortSignal): Promise<void> {
    this.take(await ask('get', '/v1/maps/{map}/edits', { path: { map: this.map_ }, ...(signal && { signal }) }));
  }

  /**
   * Changes the corrections on the server. If somebody else changed them first, loads those and changes them.
   *
   * @throws ApiError; then nothing has changed here.
   */
  async change(how: (edits: readonly Edit[]) => readonly Edit[]): Promise<void> {
    for (let tries = 0; ; ++tries) {
      const json = { format: 'stillmap-edits', version: 1, edits: how(this.edits) } as unknown as EditDocument;
      try {
        const headers: Record<string, string> = this.etag_ === undefined ? {} : { 'If-Match': this.etag_ };
        return this.take(await ask('put', '/v1/maps/{map}/edits', { path: { map: this.map_ }, json, headers }));
      } catch (error) {
        if (!(error instanceof ApiError) || error.status !== 412 || tries > 2) throw error;
        await this.load();
      }
    }
  }

  private take({ data, etag }: Answer<EditDocument>): void {
    this.etag_ = etag;
    this.edits = data.edits as unknown as readonly Edit[];
  }
}

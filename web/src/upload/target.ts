// The server's routes for uploads in parts, as one interface.

import { addressOf } from '../api/client.js';
import { ApiError } from '../api/errors.js';
import { jsonOf, send } from '../api/send.js';
import type { ListedPart } from './parts.js';

/** The result of an upload. */
export type Outcome =
  | { is: 'drive'; drive: number; needsChoice: boolean }
  | { is: 'version'; version: string; wasThere: boolean }
  | { is: 'job'; job: number };

export interface Target {
  /** Opens the upload if it is not open yet. @return the parts that the server has. */
  begin(signal: AbortSignal): Promise<ListedPart[]>;
  /** @param digest as `Content-Digest`; undefined if the browser cannot compute it. */
  put(
    n: number, body: ArrayBuffer, digest: string | undefined, onProgress: (sentBytes: number) => void, signal: AbortSignal,
  ): Promise<void>;
  /** Lets the server check the whole, which may take minutes. */
  finish(signal: AbortSignal): Promise<Outcome>;
  /** Deletes what was sent. */
  discard(): Promise<void>;
}

/** An upload as the server lists it, of a drive or of a package. */
interface Listed {
  id: number;
  status: 'open' | 'needs_choice' | 'complete' | 'failed';
  error: string;
  parts: ListedPart[];
}

/** Uploads of drives, or of packages and map files. */
export type Collection = 'drives' | 'uploads';

const kPartStandsStillS = 60;
const kCheckS = 3600;

/** Uploads drives, packages and map files in parts. */
export class PartsTarget implements Target {
  private id_: number | undefined;

  /**
   * @param json    of the requests that open and complete it.
   * @param id      of an upload that was started before.
   * @param onOpen  called with its id when it is open.
   */
  constructor(
    private readonly map_: string, private readonly collection_: Collection,
    private readonly json_: { open: object; complete?: object | undefined }, id: number | undefined, private readonly onOpen_: (id: number) => void,
  ) {
    this.id_ = id;
  }

  async begin(signal: AbortSignal): Promise<ListedPart[]> {
    if (this.id_ === undefined) {
      const opened = await this.json('POST', '', signal, { body: JSON.stringify(this.json_.open) });
      this.id_ = opened.id;
      this.onOpen_(opened.id);
      return opened.parts;
    }
    const there = await this.json('GET', '/{id}', signal);
    if (there.status === 'failed') throw new ApiError('problem', `The server could not use the upload: ${there.error}. Discard it and upload again.`);
    return there.parts;
  }

  async put(
    n: number, body: ArrayBuffer, digest: string | undefined, onProgress: (sentBytes: number) => void, signal: AbortSignal,
  ): Promise<void> {
    await send('PUT', this.address('/{id}/parts/{n}', { n }), {
      body, signal, onProgress, timeoutS: kPartStandsStillS,
      headers: { 'Content-Type': 'application/octet-stream', ...(digest === undefined ? {} : { 'Content-Digest': digest }) },
    });
  }

  async finish(signal: AbortSignal): Promise<Outcome> {
    const path = this.address('/{id}/complete');
    const { complete } = this.json_;
    const body = complete === undefined ? {} : { body: JSON.stringify(complete), headers: { 'Content-Type': 'application/json' } };
    const response = await send('POST', path, { signal, timeoutS: kCheckS, ...body });
    return this.outcome(response.status, await jsonOf(response, `POST ${path}`));
  }

  async discard(): Promise<void> {
    if (this.id_ === undefined) return;
    await send('DELETE', this.address('/{id}')).catch((error: unknown) => {
      if (!(error instanceof ApiError) || error.status !== 404) throw error;
    });
  }

  private outcome(status: number, answer: unknown): Outcome {
    if (this.collection_ === 'drives') return { is: 'drive', drive: this.id_ ?? 0, needsChoice: status === 202 };
    if (status === 202) return { is: 'job', job: (answer as { id: number }).id };
    return { is: 'version', version: (answer as { version: string }).version, wasThere: status === 200 };
  }

  private async json(method: string, rest: string, signal: AbortSignal, options: { body?: string } = {}): Promise<Listed> {
    const path = this.address(rest);
    const headers = { 'Content-Type': 'application/json' };
    const response = await send(method, path, { signal, ...options, ...(options.body === undefined ? {} : { headers }) });
    return (await jsonOf(response, `${method} ${path}`)) as Listed;
  }

  private address(rest: string, path: Record<string, number> = {}): string {
    return addressOf(`/v1/maps/{map}/${this.collection_}${rest}`, { map: this.map_, id: this.id_ ?? 0, ...path });
  }
}

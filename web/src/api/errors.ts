// Errors between the page and its server as one type, with the texts that people read.

/**
 * `down`: no answer came. `late`: none came in time. `problem`: the server refused, with a problem document or a bare
 * status. `garbled`: an answer came that cannot be read. `key`: a key is needed and the person gave none.
 */
export type Trouble = 'down' | 'late' | 'problem' | 'garbled' | 'key';

/** One line of a problem document's `errors`: where, what was found, and what was expected. */
export interface Fault {
  path: string;
  found: string;
  expected: string;
}

/** A problem document (RFC 9457) as the server sends it; every key may be missing in a proxy's answer. */
export interface ProblemDocument {
  title?: string;
  detail?: string;
  code?: string;
  request_id?: string;
  errors?: Fault[];
}

/** Why a request failed. `message` is for people; code looks at `trouble`, `status` and `code`. */
export class ApiError extends Error {
  readonly status: number | undefined;
  /** Stable code of the server's table of errors, as `OtherFrame`. */
  readonly code: string | undefined;
  readonly requestId: string | undefined;
  /** Those that the message does not contain already. */
  readonly faults: readonly Fault[];

  constructor(
    readonly trouble: Trouble,
    message: string,
    answer: { status?: number; document?: ProblemDocument; requestId?: string } = {},
  ) {
    super(message);
    this.name = 'ApiError';
    this.status = answer.status;
    this.code = answer.document?.code;
    this.requestId = answer.document?.request_id ?? answer.requestId;
    // The server's detail often contains the first of them already.
    this.faults = (answer.document?.errors ?? []).filter(({ found, expected }) => !message.includes(found) || !message.includes(expected));
  }
}

/** True if the request was aborted because nobody needs its answer. */
export function isAborted(error: unknown): boolean {
  return error instanceof DOMException && error.name === 'AbortError';
}

/** What to do after a refusal, where the server's own text does not say it. */
const kAdvice: Record<string, string> = {
  Busy: 'Try again in a moment.',
  DiskFull: 'Delete old versions, or ask the operator to free space on the server’s disk.',
  Forbidden: 'If the store has keys, use one that allows this, or ask an administrator for one.',
  InUse: 'Wait until it ends, or cancel it.',
  MapLoading: 'Try again in a moment.',
  NoMapper: 'This server has no mapper. Install it beside the server, or upload finished map packages.',
  OtherDigest: 'Choose another name: a name is never used again for something else.',
  OverQuota: 'Delete versions or drives that nobody needs, or ask the operator for a larger quota.',
  PartsMissing: 'Send the missing parts, then complete the upload again.',
  RevisionChanged: 'Somebody else, or a job, changed the map. Look at its present state, then try again.',
  TooManyRequests: 'Wait a moment, then try again.',
  TooManyStreams: 'Close other windows of this page.',
  UnknownDrive: 'It may have been deleted. Reload the list.',
  UnknownJob: 'Finished jobs are kept for some days only. Look at the list of jobs.',
  UnknownMap: 'It may have been deleted. Look at the list of maps.',
  UnknownVersion: 'It may have been deleted. Look at the map’s versions.',
};

/** The error for an answer with an error status. @param where the request, as `GET /v1/maps`. */
export function refusal(where: string, status: number, document: ProblemDocument | undefined): ApiError {
  const said = [document?.title, document?.detail].filter((text) => text !== undefined && text !== '').join(': ');
  const advice = kAdvice[document?.code ?? ''] ?? '';
  const message = said === '' ? bareStatus(where, status) : [sentence(said), advice].filter(Boolean).join(' ');
  return new ApiError('problem', message, { status, ...(document === undefined ? {} : { document }) });
}

/** The problem document in a text, if it is one. */
export function parseProblem(contentType: string, text: string): ProblemDocument | undefined {
  if (!contentType.includes('application/problem+json')) return undefined;
  try {
    const document: unknown = JSON.parse(text);
    return typeof document === 'object' && document !== null ? document : undefined;
  } catch {
    return undefined;
  }
}

export function down(): ApiError {
  return new ApiError('down', 'The server does not answer. Check that “stillmap serve” is running and that this machine can reach it.');
}

export function late(seconds: number): ApiError {
  return new ApiError('late', `The server did not answer within ${seconds} s. Try again; if this persists, look at the server’s log.`);
}

/** Any thrown value as an error that can be shown. */
export function toApiError(error: unknown): ApiError {
  if (error instanceof ApiError) return error;
  return new ApiError('garbled', error instanceof Error ? error.message : String(error));
}

const kStatusWords: Record<number, string> = {
  404: 'It does not exist, or was deleted. Check the address.',
  413: 'It is larger than the server or its proxy allows. Ask the operator to raise the limit.',
  502: 'The proxy could not reach the server. Check that “stillmap serve” is running.',
  503: 'The server accepts no requests now. Try again in a moment.',
  504: 'The server did not answer the proxy in time. Try again in a moment.',
};

function bareStatus(where: string, status: number): string {
  return [`${where} failed with status ${status}.`, kStatusWords[status]].filter(Boolean).join(' ');
}

function sentence(text: string): string {
  const first = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?]$/.test(first) ? first : `${first}.`;
}

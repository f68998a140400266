// What can go wrong between the page and its server, as one type, and the words a person reads about it.

/**
 * `down`: no answer came. `late`: none came in time. `problem`: the server refused, with a problem document or a bare
 * status. `garbled`: an answer came that cannot be read. `key`: a key is needed and the person gave none.
 */
export type Trouble = 'down' | 'late' | 'problem' | 'garbled' | 'key';

/** One line of a problem document's `errors`: what stood where, and what may stand there. */
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

/** Why a request brought nothing. `message` is a sentence for people; programs look at `trouble`, `status` and `code`. */
export class ApiError extends Error {
  readonly status: number | undefined;
  /** Stable code of the server's table of errors, as `OtherFrame`. */
  readonly code: string | undefined;
  readonly requestId: string | undefined;
  /** What the message does not say already. */
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
    // The server's detail often says the first of them already.
    this.faults = (answer.document?.errors ?? []).filter(({ found, expected }) => !message.includes(found) || !message.includes(expected));
  }
}

/** True for an error that means "nobody wants the answer any more". */
export function isAborted(error: unknown): boolean {
  return error instanceof DOMException && error.name === 'AbortError';
}

/** What to do about a refusal, where the server's own words do not say it. */
const kAdvice: Record<string, string> = {
  Busy: 'It takes more work again in a moment.',
  DiskFull: 'An operator has to make room on the server’s disk, or old versions can be deleted.',
  Forbidden: 'Use a key that has this scope, or ask for one.',
  InUse: 'Wait for it to end, or cancel it.',
  MapLoading: 'It is ready in a moment.',
  NoMapper: 'This server was installed without the mapper; maps can only be uploaded as finished packages.',
  OverQuota: 'Delete versions or drives that nobody needs, or ask for a larger quota.',
  RevisionChanged: 'Somebody changed the map in the meantime. Look at it again, then decide.',
  TooManyRequests: 'Wait a moment.',
  TooManyStreams: 'Close other windows of this page.',
  UnknownDrive: 'It may have been deleted in the meantime.',
  UnknownJob: 'It was forgotten: finished jobs are kept for some days only.',
  UnknownMap: 'It may have been deleted in the meantime.',
  UnknownVersion: 'It may have been deleted in the meantime.',
};

/** The error of an answer that is no success. @param where what was asked, as `GET /v1/maps`. */
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
  return new ApiError('down', 'The server does not answer. Check that “stillmap serve” is running and can be reached.');
}

export function late(seconds: number): ApiError {
  return new ApiError('late', `The server did not answer within ${seconds} s.`);
}

/** Any thrown thing as one that can be shown. */
export function toApiError(error: unknown): ApiError {
  if (error instanceof ApiError) return error;
  return new ApiError('garbled', error instanceof Error ? error.message : String(error));
}

const kStatusWords: Record<number, string> = {
  404: 'It is not there (any more).',
  413: 'It is larger than the server, or what stands in front of it, takes.',
  502: 'What stands in front of the server could not reach it.',
  503: 'The server takes nothing at the moment.',
  504: 'The server did not answer in time.',
};

function bareStatus(where: string, status: number): string {
  return [`${where} was answered with status ${status}.`, kStatusWords[status]].filter(Boolean).join(' ');
}

function sentence(text: string): string {
  const first = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?]$/.test(first) ? first : `${first}.`;
}

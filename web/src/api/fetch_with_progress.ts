/** The options of fetch that `fetchWithProgress` supports. */
export interface Upload {
  method: string;
  headers: Record<string, string>;
  signal: AbortSignal;
  body?: BodyInit;
}

/**
 * `fetch` with progress of the upload, by XMLHttpRequest: the only interface of browsers that reports it.
 *
 * @throws AbortError when the signal fires, TypeError when no answer came: as fetch.
 */
export function fetchWithProgress(url: string, upload: Upload, onProgress: (sentBytes: number) => void): Promise<Response> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    const abort = (): void => request.abort();
    request.open(upload.method, url);
    request.responseType = 'arraybuffer';
    for (const [name, value] of Object.entries(upload.headers)) request.setRequestHeader(name, value);
    request.upload.onprogress = ({ loaded }) => onProgress(loaded);
    request.onload = () => resolve(responseOf(request));
    request.onerror = () => reject(new TypeError('no answer'));
    request.onabort = () => reject(upload.signal.reason);
    request.onloadend = () => upload.signal.removeEventListener('abort', abort);
    upload.signal.addEventListener('abort', abort, { once: true });
    request.send((upload.body ?? null) as XMLHttpRequestBodyInit | null);
  });
}

function responseOf(request: XMLHttpRequest): Response {
  const headers = new Headers();
  for (const line of request.getAllResponseHeaders().trim().split(/\r\n/)) {
    const colon = line.indexOf(':');
    if (colon > 0) headers.append(line.slice(0, colon), line.slice(colon + 1).trim());
  }
  const hasBody = request.status !== 204 && request.status !== 304;
  return new Response(hasBody ? (request.response as ArrayBuffer) : null, { status: request.status, headers });
}

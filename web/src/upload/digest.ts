/** SHA-256 of bytes; undefined if the browser has no such function (a page without TLS from another machine). */
export async function sha256(bytes: ArrayBuffer): Promise<Uint8Array | undefined> {
  if (globalThis.crypto?.subtle === undefined) return undefined;
  return new Uint8Array(await crypto.subtle.digest('SHA-256', bytes));
}

export function hex(bytes: Uint8Array): string {
  return [...bytes].map((byte) => byte.toString(16).padStart(2, '0')).join('');
}

/** In the form of RFC 9530's `Content-Digest`. */
export function contentDigest(sum: Uint8Array): string {
  return `sha-256=:${btoa(String.fromCharCode(...sum))}:`;
}

/**
 * Unpacks LZF, as PCD's `binary_compressed` uses it.
 *
 * @param size bytes that must come out; the caller has bounded it.
 * @returns null when the bytes break off, refer to before their begin, or give another size.
 * @see the format's only description is its reference code, liblzf 3.6 (`lzf_d.c`), M. Lehmann.
 */
export function unpackLzf(packed: Uint8Array, size: number): Uint8Array<ArrayBuffer> | null {
  const out = new Uint8Array(size);
  let from = 0;
  let to = 0;
  while (from < packed.length) {
    const control = packed[from++]!;
    if (control < 32) {
      const count = control + 1;
      if (from + count > packed.length || to + count > size) return null;
      out.set(packed.subarray(from, from + count), to);
      from += count;
      to += count;
      continue;
    }
    let count = control >> 5;
    if (count === 7) count += packed[from++] ?? Number.NaN;
    count += 2;
    const distance = ((control & 31) << 8) + (packed[from++] ?? Number.NaN) + 1;
    // Written so that NaN, a byte that was not there, fails too.
    if (!(distance <= to) || !(to + count <= size)) return null;
    // Byte by byte: a reference may repeat what it is just writing.
    for (let i = 0; i < count; ++i, ++to) out[to] = out[to - distance]!;
  }
  return to === size ? out : null;
}

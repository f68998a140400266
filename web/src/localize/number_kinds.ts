/** Kinds of numbers in point files, and how each is read from bytes. */
export interface NumberKind {
  bytes: number;
  whole: boolean;
  read(view: DataView, offset: number, littleEndian: boolean): number;
}

const kind = (bytes: number, whole: boolean, read: NumberKind['read']): NumberKind => ({ bytes, whole, read });

export const kNumberKinds = {
  i1: kind(1, true, (view, at) => view.getInt8(at)),
  u1: kind(1, true, (view, at) => view.getUint8(at)),
  i2: kind(2, true, (view, at, little) => view.getInt16(at, little)),
  u2: kind(2, true, (view, at, little) => view.getUint16(at, little)),
  i4: kind(4, true, (view, at, little) => view.getInt32(at, little)),
  u4: kind(4, true, (view, at, little) => view.getUint32(at, little)),
  i8: kind(8, true, (view, at, little) => Number(view.getBigInt64(at, little))),
  u8: kind(8, true, (view, at, little) => Number(view.getBigUint64(at, little))),
  f4: kind(4, false, (view, at, little) => view.getFloat32(at, little)),
  f8: kind(8, false, (view, at, little) => view.getFloat64(at, little)),
} as const;

/** A column of a point file: `count` numbers a point. */
export interface Field {
  name: string;
  kind: NumberKind;
  count: number;
}

/**
 * Which fields are x, y and z.
 *
 * @returns their places in `fields`, or null when one is missing, doubled or not a single number.
 */
export function coordinateFields(fields: readonly Field[]): [number, number, number] | null {
  const places = ['x', 'y', 'z'].map((axis) => {
    const found = fields.flatMap((field, i) => (field.name.toLowerCase() === axis ? [i] : []));
    return found.length === 1 && fields[found[0]!]!.count === 1 ? found[0]! : -1;
  });
  return places.includes(-1) ? null : (places as [number, number, number]);
}

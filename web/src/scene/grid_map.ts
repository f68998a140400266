/** A layer of the server's: square cells of the ground, by tile. */
export interface GridAnswer {
  readonly tile_size_m: number;
  readonly cell_m: number;
  readonly cells_per_tile: number;
  readonly origin: readonly number[];
  readonly tiles: readonly (readonly number[])[];
  readonly bands: readonly GridBand[];
}

export interface GridBand {
  readonly name: string;
  readonly type: string;
  /** Base64 of the values, little endian. */
  readonly data: string;
}

const kTypes = {
  uint8: Uint8Array, uint16: Uint16Array, uint32: Uint32Array, int16: Int16Array, int32: Int32Array, float32: Float32Array,
  float64: Float64Array,
} as const;

/** Cells that have a value: corner of lowest x and y, height and value of each; relative to the grid's origin [m]. */
export interface Cells {
  readonly count: number;
  readonly cellM: number;
  readonly x: Float32Array;
  readonly y: Float32Array;
  readonly height: Float32Array;
  readonly value: Float32Array;
}

/**
 * The cells of one band that have a height and a value that `holds`.
 *
 * @throws Error in words when a band is missing or has not as many values as there are cells.
 */
export function cellsOf(grid: GridAnswer, band: string, holds: (value: number) => boolean): Cells {
  const each = grid.cells_per_tile ** 2;
  const values = bandOf(grid, band, each * grid.tiles.length);
  const heights = bandOf(grid, 'height', each * grid.tiles.length);
  const kept: number[] = [];
  for (let cell = 0; cell < values.length; ++cell) {
    if (Number.isFinite(heights[cell]) && holds(values[cell] as number)) kept.push(cell);
  }
  const column = (value: (cell: number) => number): Float32Array => Float32Array.from(kept, value);
  const corner = (cell: number, axis: 0 | 1): number => {
    const within = cell % each;
    const step = axis === 0 ? within % grid.cells_per_tile : Math.floor(within / grid.cells_per_tile);
    return ((grid.tiles[Math.floor(cell / each)] as readonly number[])[axis] as number) * grid.tile_size_m + step * grid.cell_m;
  };
  return {
    count: kept.length, cellM: grid.cell_m,
    x: column((cell) => corner(cell, 0)), y: column((cell) => corner(cell, 1)),
    height: column((cell) => heights[cell] as number), value: column((cell) => values[cell] as number),
  };
}

function bandOf(grid: GridAnswer, name: string, count: number): ArrayLike<number> {
  const band = grid.bands.find((one) => one.name === name);
  if (band === undefined) throw new Error(`The layer has no values named “${name}”.`);
  const type = kTypes[band.type as keyof typeof kTypes];
  if (type === undefined) throw new Error(`The layer's values “${name}” are of the unknown type “${band.type}”.`);
  const bytes = Uint8Array.from(atob(band.data), (letter) => letter.charCodeAt(0));
  if (bytes.length !== count * type.BYTES_PER_ELEMENT) {
    throw new Error(`The layer's values “${name}” have ${bytes.length} bytes, expected ${count * type.BYTES_PER_ELEMENT}.`);
  }
  return new type(bytes.buffer);
}

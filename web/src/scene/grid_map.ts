/** A layer of the server's: square cells of the ground, by tile. */
export interface GridAnswer {
  readonly tile_size_m: number;
  readonly cell_m: number;
  readonly cells_per_side: number;
  readonly origin: readonly number[];
  readonly tiles: readonly (readonly number[])[];
  readonly bands: readonly GridBand[];
}

export interface GridBand {
  readonly name: string;
  /** One a cell; NaN where there is none. */
  readonly values: Float32Array;
}

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
  const each = grid.cells_per_side ** 2;
  const values = bandOf(grid, band, each * grid.tiles.length);
  const heights = bandOf(grid, 'height', each * grid.tiles.length);
  const kept: number[] = [];
  for (let cell = 0; cell < values.length; ++cell) {
    if (Number.isFinite(heights[cell]) && holds(values[cell] as number)) kept.push(cell);
  }
  const column = (value: (cell: number) => number): Float32Array => Float32Array.from(kept, value);
  const corner = (cell: number, axis: 0 | 1): number => {
    const within = cell % each;
    const step = axis === 0 ? within % grid.cells_per_side : Math.floor(within / grid.cells_per_side);
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
  if (band.values.length !== count) {
    throw new Error(`The layer's values “${name}” are ${band.values.length}, expected ${count}.`);
  }
  return band.values;
}

/** A layer of the server: square cells of the ground, by tile. */
export interface GridHead {
  readonly tile_size_m: number;
  readonly cell_m: number;
  readonly cells_per_side: number;
  readonly origin: readonly number[];
  readonly tiles: readonly (readonly number[])[];
  readonly bands: readonly { readonly name: string; readonly url: string }[];
}

/** Cells that have a value: corner of lowest x and y, height and value of each; relative to the grid's origin [m]. */
export interface Cells {
  readonly count: number;
  readonly cellM: number;
  readonly x: Float64Array;
  readonly y: Float64Array;
  readonly height: Float32Array;
  readonly value: Float32Array;
}

/**
 * The cells that have a height and a value that `holds`.
 *
 * @param heights, values bands of the layer: tile after tile, in a tile row after row from the south; NaN = none.
 * @throws Error when a band does not have one value per cell.
 */
export function cellsOf(grid: GridHead, heights: Float32Array, values: Float32Array, holds: (value: number) => boolean): Cells {
  const each = grid.cells_per_side ** 2;
  for (const band of [heights, values]) {
    if (band.length !== each * grid.tiles.length) {
      throw new Error(`A band of the layer has ${band.length} values, and ${each * grid.tiles.length} are expected. Reload the page.`);
    }
  }
  const kept: number[] = [];
  for (let cell = 0; cell < values.length; ++cell) {
    const value = values[cell] as number;
    if (Number.isFinite(heights[cell]) && Number.isFinite(value) && holds(value)) kept.push(cell);
  }
  const column = (value: (cell: number) => number): Float32Array => Float32Array.from(kept, value);
  const corner = (cell: number, axis: 0 | 1): number => {
    const within = cell % each;
    const step = axis === 0 ? within % grid.cells_per_side : Math.floor(within / grid.cells_per_side);
    return ((grid.tiles[Math.floor(cell / each)] as readonly number[])[axis] as number) * grid.tile_size_m + step * grid.cell_m;
  };
  return {
    count: kept.length, cellM: grid.cell_m,
    x: Float64Array.from(kept, (cell) => corner(cell, 0)), y: Float64Array.from(kept, (cell) => corner(cell, 1)),
    height: column((cell) => heights[cell] as number), value: column((cell) => values[cell] as number),
  };
}

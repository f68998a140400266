import { coordinateOf, type Points } from './point_layout.js';
import { add, kKinds, type Vec3 } from './types.js';

export const kExportFormats = ['ply', 'pcd', 'csv'] as const;
export type ExportFormat = (typeof kExportFormats)[number];

/** Floats are 1 mm coarse below it [m]. */
const kCoarseFromM = 16_384;

/**
 * Points as a file in map coordinates.
 *
 * PLY (binary, double coordinates) and CSV are exact to the tile's own resolution. PCD has float coordinates, as its
 * readers expect.
 * @param origin of the map in map coordinates [m].
 * @throws Error if coordinates are too large for the floats of PCD.
 */
export function exportPoints(tiles: readonly Points[], origin: Vec3, format: ExportFormat): Blob {
  const write = { ply: writePly, pcd: writePcd, csv: writeCsv }[format];
  return new Blob(write(tiles, origin) as BlobPart[], { type: 'application/octet-stream' });
}

type Writer = (tiles: readonly Points[], origin: Vec3) => (string | ArrayBuffer)[];

const writePly: Writer = (tiles, origin) => {
  const bytes = 3 * 8 + 4 + 2 + 1;
  const bodies = tiles.map((points) => {
    const body = new DataView(new ArrayBuffer(bytes * points.count));
    for (let i = 0; i < points.count; ++i) {
      for (const axis of [0, 1, 2] as const) body.setFloat64(i * bytes + 8 * axis, coordinateOf(points, i, axis) + origin[axis], true);
      body.setFloat32(i * bytes + 24, points.intensities[i] as number, true);
      body.setUint16(i * bytes + 28, points.observations[i] as number, true);
      body.setUint8(i * bytes + 30, points.kinds[i] as number);
    }
    return body.buffer as ArrayBuffer;
  });
  const kinds = kKinds.map((kind, number) => `${number} ${kind}`).join(', ');
  const header = [
    'ply', 'format binary_little_endian 1.0', `comment map frame, metres; kind: ${kinds}`, `element vertex ${countOf(tiles)}`,
    'property double x', 'property double y', 'property double z', 'property float intensity',
    'property ushort observations', 'property uchar kind', 'end_header', '',
  ];
  return [header.join('\n'), ...bodies];
};

const writePcd: Writer = (tiles, origin) => {
  const largest = tiles.flatMap(({ corner }) => add(corner, origin)).reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  if (largest >= kCoarseFromM) {
    throw new Error(`PCD cannot hold these points to the millimetre: its numbers are too coarse ${Math.round(largest / 1000)} km from the origin ` +
      'of the map frame. Choose PLY or CSV.');
  }
  const bodies = tiles.map((points) => {
    const body = new DataView(new ArrayBuffer(16 * points.count));
    for (let i = 0; i < points.count; ++i) {
      for (const axis of [0, 1, 2] as const) body.setFloat32(16 * i + 4 * axis, coordinateOf(points, i, axis) + origin[axis], true);
      body.setFloat32(16 * i + 12, points.intensities[i] as number, true);
    }
    return body.buffer as ArrayBuffer;
  });
  const count = countOf(tiles);
  const header = [
    '# .PCD v0.7 - Point Cloud Data file format', 'VERSION 0.7', 'FIELDS x y z intensity', 'SIZE 4 4 4 4', 'TYPE F F F F',
    'COUNT 1 1 1 1', `WIDTH ${count}`, 'HEIGHT 1', 'VIEWPOINT 0 0 0 1 0 0 0', `POINTS ${count}`, 'DATA binary', '',
  ];
  return [header.join('\n'), ...bodies];
};

const writeCsv: Writer = (tiles, origin) => {
  const lines = ['x_m,y_m,z_m,intensity,observations,kind\n'];
  for (const points of tiles) {
    for (let i = 0; i < points.count; ++i) {
      const place = ([0, 1, 2] as const).map((axis) => (coordinateOf(points, i, axis) + origin[axis]).toFixed(4)).join(',');
      lines.push(`${place},${points.intensities[i]},${points.observations[i]},${kKinds[points.kinds[i] as number]}\n`);
    }
  }
  return lines;
};

function countOf(tiles: readonly Points[]): number {
  return tiles.reduce((sum, { count }) => sum + count, 0);
}

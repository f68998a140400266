import type { Points } from './point_layout.js';
import { kKinds, type Vec3 } from './types.js';

export const kExportFormats = ['ply', 'pcd', 'csv'] as const;
export type ExportFormat = (typeof kExportFormats)[number];

/**
 * Points as a file in map coordinates.
 *
 * PLY (binary, double coordinates) and CSV are exact to the tile's own resolution; PCD has float
 * coordinates, as its readers expect: steps of 1 mm at 8 km from the map frame's origin.
 * @param origin of the points in map coordinates [m].
 */
export function exportPoints(points: Points, origin: Vec3, format: ExportFormat): Blob {
  const write = { ply: writePly, pcd: writePcd, csv: writeCsv }[format];
  return new Blob(write(points, origin) as BlobPart[], { type: 'application/octet-stream' });
}

function writePly(points: Points, origin: Vec3): (string | ArrayBuffer)[] {
  const bytes = 3 * 8 + 4 + 2 + 1;
  const body = new DataView(new ArrayBuffer(bytes * points.count));
  for (let i = 0; i < points.count; ++i) {
    for (let axis = 0; axis < 3; ++axis) body.setFloat64(i * bytes + 8 * axis, coordinate(points, origin, i, axis), true);
    body.setFloat32(i * bytes + 24, points.intensities[i] as number, true);
    body.setUint16(i * bytes + 28, points.observations[i] as number, true);
    body.setUint8(i * bytes + 30, points.kinds[i] as number);
  }
  const kinds = kKinds.map((kind, number) => `${number} ${kind}`).join(', ');
  const header = [
    'ply', 'format binary_little_endian 1.0', `comment map frame, metres; kind: ${kinds}`, `element vertex ${points.count}`,
    'property double x', 'property double y', 'property double z', 'property float intensity',
    'property ushort observations', 'property uchar kind', 'end_header', '',
  ];
  return [header.join('\n'), body.buffer as ArrayBuffer];
}

function writePcd(points: Points, origin: Vec3): (string | ArrayBuffer)[] {
  const body = new DataView(new ArrayBuffer(16 * points.count));
  for (let i = 0; i < points.count; ++i) {
    for (let axis = 0; axis < 3; ++axis) body.setFloat32(16 * i + 4 * axis, coordinate(points, origin, i, axis), true);
    body.setFloat32(16 * i + 12, points.intensities[i] as number, true);
  }
  const header = [
    '# .PCD v0.7 - Point Cloud Data file format', 'VERSION 0.7', 'FIELDS x y z intensity', 'SIZE 4 4 4 4', 'TYPE F F F F',
    'COUNT 1 1 1 1', `WIDTH ${points.count}`, 'HEIGHT 1', 'VIEWPOINT 0 0 0 1 0 0 0', `POINTS ${points.count}`, 'DATA binary', '',
  ];
  return [header.join('\n'), body.buffer as ArrayBuffer];
}

function writeCsv(points: Points, origin: Vec3): string[] {
  const lines = ['x_m,y_m,z_m,intensity,observations,kind\n'];
  for (let i = 0; i < points.count; ++i) {
    const place = [0, 1, 2].map((axis) => coordinate(points, origin, i, axis).toFixed(4)).join(',');
    lines.push(`${place},${points.intensities[i]},${points.observations[i]},${kKinds[points.kinds[i] as number]}\n`);
  }
  return lines;
}

function coordinate(points: Points, origin: Vec3, point: number, axis: number): number {
  return (points.positions[3 * point + axis] as number) + (origin[axis] as number);
}

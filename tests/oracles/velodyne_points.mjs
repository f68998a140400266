// Points of Velodyne packets by a program that is not ours: @foxglove/velodyne-cloud.
// usage: node velodyne_points.mjs SPEC.json
// SPEC: {model: "VLP16", calibration: its CalibrationData or null, scans: [{out: FILE, packets: [{base64, from_stamp_s}]}]}
// FILE: x y z intensity time for each point, as little-endian floats of 32 bits; time [s] from the scan's stamp.

import { readFileSync, writeFileSync } from 'node:fs';
import velodyne from '@foxglove/velodyne-cloud';

const { Calibration, Model, RawPacket, Transformer } = velodyne;
const spec = JSON.parse(readFileSync(process.argv[2], 'utf8'));
const calibration = new Calibration(Model[spec.model], spec.calibration ?? undefined);
const transformer = new Transformer(calibration, { minRange: 0.001, maxRange: 1000 });
for (const scan of spec.scans) {
  const points = [];
  const output = {
    addPoint: (x, y, z, distance, intensity, ring, azimuth, ns) => points.push(x, y, z, intensity, 1e-9 * ns),
  };
  for (const { base64, from_stamp_s: fromStamp } of scan.packets) {
    const packet = new RawPacket(new Uint8Array(Buffer.from(base64, 'base64')));
    transformer.unpack(packet, 0, fromStamp, output);
  }
  writeFileSync(scan.out, Buffer.from(Float32Array.from(points).buffer));
}

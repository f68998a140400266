// Reads an exported point cloud with programs that are not ours: three's PCD and PLY loaders, and copc (LAS).
// usage: node read_cloud.mjs FILE.pcd|FILE.ply|FILE.las OUT
// OUT: a point after the other, as 6 little-endian doubles: x y z intensity, then what says what it is (PLY: kind; LAS:
// class and whether it is synthetic, as 10 * class + synthetic; PCD: 0) and the LAS user data. A line of JSON on stdout.

import { readFileSync, writeFileSync } from 'node:fs';
import copc from 'copc';
import { PCDLoader } from 'three/addons/loaders/PCDLoader.js';
import { PLYLoader } from 'three/addons/loaders/PLYLoader.js';

const [file, out] = process.argv.slice(2);
const buffer = readFileSync(file);
const arrayBuffer = buffer.buffer.slice(buffer.byteOffset, buffer.byteOffset + buffer.byteLength);

function fromGeometry(geometry) {
  const { position, intensity, kind } = geometry.attributes;
  return {
    count: position.count,
    point: (i) => [position.getX(i), position.getY(i), position.getZ(i), intensity.getX(i), kind ? kind.getX(i) : 0, 0],
    about: { attributes: Object.keys(geometry.attributes) },
  };
}

function readPly() {
  const loader = new PLYLoader();
  loader.setCustomPropertyNameMapping({ intensity: ['intensity'], kind: ['kind'] });
  return fromGeometry(loader.parse(arrayBuffer));
}

async function readLas() {
  const { Las } = copc;
  const header = Las.Header.parse(buffer);
  const get = async (begin, end) => buffer.subarray(begin, end);
  const vlrs = await Las.Vlr.walk(get, header);
  const wkt = Las.Vlr.find(vlrs, 'LASF_Projection', 2112);
  const view = Las.View.create(buffer.subarray(header.pointDataOffset), header);
  const [x, y, z, intensity, classification, synthetic, user, returns] = [
    'X', 'Y', 'Z', 'Intensity', 'Classification', 'Synthetic', 'UserData', 'NumberOfReturns'].map((d) => view.getter(d));
  return {
    count: header.pointCount,
    point: (i) => [x(i), y(i), z(i), intensity(i), 10 * classification(i) + synthetic(i), user(i)],
    about: { header, returns: header.pointCount > 0 ? returns(0) : 0,
      wkt: wkt && buffer.subarray(wkt.contentOffset, wkt.contentOffset + wkt.contentLength).toString() },
  };
}

const cloud = file.endsWith('.pcd') ? fromGeometry(new PCDLoader().parse(arrayBuffer).geometry)
  : file.endsWith('.ply') ? readPly() : await readLas();
const values = new Float64Array(6 * cloud.count);
for (let i = 0; i < cloud.count; ++i) values.set(cloud.point(i), 6 * i);
writeFileSync(out, Buffer.from(values.buffer));
console.log(JSON.stringify({ count: cloud.count, ...cloud.about }));

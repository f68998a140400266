// Scans that a person drops on the page, good and damaged.
import assert from 'node:assert/strict';
import { test } from 'node:test';

const { checkSize, readScanFile } = await import('../../../web/dist/unit/localize/scan_file.js');

const kPoints = [[1.5, -2.25, 0.125], [100, 0.5, -3], [0, 0, 0], [Number.NaN, 1, 2], [-7, 8, 9]];
const kKept = [1.5, -2.25, 0.125, 100, 0.5, -3, -7, 8, 9];

const bytesOf = (...pieces) => Buffer.concat(pieces.map((piece) => Buffer.from(piece)));
const bufferOf = (bytes) => bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
const floats = (values) => Buffer.from(new Float32Array(values).buffer);

function pcdHeader(data, points, fields = 'x y z i', size = '4 4 4 2', type = 'F F F U', count = '1 1 1 1') {
  return `# .PCD v0.7\nVERSION 0.7\nFIELDS ${fields}\nSIZE ${size}\nTYPE ${type}\nCOUNT ${count}\n` +
    `WIDTH ${points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS ${points}\nDATA ${data}\n`;
}

function binaryRows(points) {
  return bytesOf(...points.map((point) => bytesOf(floats(point), [7, 0])));
}

/** LZF without a single reference: literal runs of up to 32 bytes, which any reader must take. */
function literalLzf(bytes) {
  const runs = [];
  for (let at = 0; at < bytes.length; at += 32) {
    const run = bytes.subarray(at, at + 32);
    runs.push(bytesOf([run.length - 1], run));
  }
  return bytesOf(...runs);
}

function compressedBody(columns, packed = literalLzf(columns)) {
  const sizes = Buffer.alloc(8);
  sizes.writeUInt32LE(packed.length, 0);
  sizes.writeUInt32LE(columns.length, 4);
  return bytesOf(sizes, packed);
}

const columnsOf = (points) =>
  bytesOf(...[0, 1, 2].map((axis) => floats(points.map((point) => point[axis]))), Buffer.alloc(2 * points.length));

const read = (name, bytes, limits) => readScanFile(name, bufferOf(bytes), limits);

test('PCD in its three encodings gives the same points, and what is none is counted', () => {
  const ascii = kPoints.map((point) => `${point.join(' ').replace('NaN', 'nan')} 7`).join('\n');
  const files = [
    bytesOf(pcdHeader('ascii', 5), ascii, '\n'),
    bytesOf(pcdHeader('binary', 5), binaryRows(kPoints)),
    bytesOf(pcdHeader('binary_compressed', 5), compressedBody(columnsOf(kPoints))),
  ];
  for (const bytes of files) {
    const scan = read('a.pcd', bytes);
    assert.deepEqual([...scan.positions], kKept);
    assert.deepEqual([scan.pointsInFile, scan.dropped], [5, 2]);
    assert.equal(scan.contentType, 'application/vnd.pcd');
    assert.equal(scan.body.length, bytes.length, 'the server gets the file as it is');
  }
});

test('a header in another style is read too: columns, capitals, tabs, Windows line ends, colours beside', () => {
  const header = 'VERSION .7\r\nCOLUMNS rgb  X\tY Z\r\nSIZE 4 8 8 8\r\nTYPE f f f f\r\nWIDTH 1\r\nHEIGHT 1\r\nDATA binary\r\n';
  const scan = read('a.pcd', bytesOf(header, floats([9]), Buffer.from(new Float64Array([1.5, 2.5, 3.5]).buffer)));
  assert.deepEqual([...scan.positions], [1.5, 2.5, 3.5]);
});

test('LZF references repeat what they are just writing', () => {
  // 'ab' as literals, then 10 bytes from 2 back: the packed form of abababababab.
  const packed = Buffer.from([1, 97, 98, (7 << 5) | 0, 1, 1]);
  const columns = Buffer.from('abababababab');
  const header = pcdHeader('binary_compressed', 1, 'x y z', '4 4 4', 'F F F', '1 1 1');
  const scan = read('a.pcd', bytesOf(header, compressedBody(columns, packed)));
  assert.deepEqual([...scan.positions], [...new Float32Array(bufferOf(columns))]);
});

test('padding columns count as bytes and not as points', () => {
  const header = pcdHeader('binary', 1, 'x y _ z', '4 4 1 4', 'F F U F', '1 1 4 1');
  const scan = read('a.pcd', bytesOf(header, floats([1, 2]), [9, 9, 9, 9], floats([3])));
  assert.deepEqual([...scan.positions], [1, 2, 3]);
});

test('a damaged PCD file is refused with its name, what is wrong and what to do', () => {
  const cases = [
    [bytesOf(pcdHeader('binary', 5), binaryRows(kPoints).subarray(3)), /a\.pcd: it ends after 67 of 70 bytes of points\. The file is damaged.* export it again\.$/],
    [bytesOf(pcdHeader('ascii', 2), '1 2 3 4\n'.repeat(1), '    '.repeat(9)), /it has 1 points, and its header promises 2/],
    [bytesOf(pcdHeader('ascii', 2), '1 2 3 4\n1 2 3\n'), /point 2 has not 4 numbers/],
    [bytesOf(pcdHeader('ascii', 1), '1,5 2 3 4\n'), /contain ','.* decimal point/],
    [bytesOf(pcdHeader('binary', 4_000_000_000)), /4000000000 points, and at most/],
    [bytesOf(pcdHeader('binary', '1e999')), /does not say how many points/],
    [bytesOf(pcdHeader('zipped', 5)), /DATA zipped is not/],
    [bytesOf(pcdHeader('binary', 1, 'x y q i')), /FIELDS x y q i has not exactly one usable z/],
    [bytesOf(pcdHeader('binary', 1, 'x y z i', '4 4 8 2', 'F F U U')), /not exactly one usable z/],
    [bytesOf(pcdHeader('binary', 1, 'x y z i', '4 4 3 2')), /the field z has no usable SIZE/],
    [bytesOf(pcdHeader('binary', 1, 'x y z i', '4 4 4', 'F F F')), /the field i has no usable SIZE/],
    [bytesOf(pcdHeader('binary_compressed', 5), compressedBody(columnsOf(kPoints)).subarray(0, 60)), /ends after 60 bytes of compressed points/],
    [bytesOf(pcdHeader('binary_compressed', 5), compressedBody(columnsOf(kPoints)).subarray(0, 5)), /ends after 5 bytes/],
    [bytesOf(pcdHeader('binary_compressed', 6), compressedBody(columnsOf(kPoints))), /70 bytes, and its header promises 84/],
    [bytesOf(pcdHeader('binary_compressed', 5), compressedBody(columnsOf(kPoints), Buffer.from([0x20, 5]))), /points cannot be read \(.*export it again/],
    [bytesOf('VERSION 0.7\nFIELDS x y z\n'), /no DATA line/],
  ];
  for (const [bytes, expected] of cases) assert.throws(() => read('a.pcd', bytes), expected);
});

const kPlyHeader = (format, count) =>
  `ply\nformat ${format} 1.0\ncomment made by hand\nelement camera 1\nproperty list uchar int tags\n` +
  `element vertex ${count}\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n` +
  `element face 1\nproperty list uchar int vertex_indices\nend_header\n`;

test('PLY in its three encodings gives the same points, which go to the server raw', () => {
  const tags = (big) => (big ? [2, 0, 0, 0, 1, 0, 0, 0, 2] : [2, 1, 0, 0, 0, 2, 0, 0, 0]);
  const swapped = (bytes) => Buffer.from(bytes).swap32();
  const rows = (big) => bytesOf(...kPoints.map((p) => bytesOf(big ? swapped(floats(p)) : floats(p), [7])));
  const files = [
    bytesOf(kPlyHeader('ascii', 5), '2 1 2\n', kPoints.map((p) => `${p.join(' ')} 7`).join('\n'), '\n3 0 1 2\n'),
    bytesOf(kPlyHeader('binary_little_endian', 5), tags(false), rows(false)),
    bytesOf(kPlyHeader('binary_big_endian', 5), tags(true), rows(true)),
  ];
  for (const bytes of files) {
    const scan = read('a.ply', bytes);
    assert.deepEqual([...scan.positions], kKept);
    assert.deepEqual([scan.layout, scan.contentType], ['xyz', 'application/octet-stream']);
    assert.deepEqual([...new Float32Array(bufferOf(Buffer.from(scan.body)))], kKept);
  }
});

test('double coordinates in a PLY file, and faces that the page does not need', () => {
  const header = 'ply\r\nformat binary_little_endian 1.0\r\nelement vertex 2\r\nproperty double X\r\nproperty double Y\r\n' +
    'property double Z\r\nelement face 1\r\nproperty list uchar int corners\r\nend_header\r\n';
  const bytes = bytesOf(header, Buffer.from(new Float64Array([1.1, 2.2, 3.3, 4.4, 5.5, 6.6]).buffer), [1, 0, 0, 0, 0]);
  assert.deepEqual([...read('a.ply', bytes).positions], [1.1, 2.2, 3.3, 4.4, 5.5, 6.6].map(Math.fround));
});

test('a damaged PLY file is refused with its name, what is wrong and what to do', () => {
  const vertex = (...properties) => `ply\nformat ascii 1.0\nelement vertex 1\n${properties.map((one) => `property ${one}\n`).join('')}end_header\n1\n`;
  const binary = bytesOf(kPlyHeader('binary_little_endian', 5), [2, 1, 0, 0, 0, 2, 0, 0, 0]);
  const cases = [
    [bytesOf(kPlyHeader('ascii', 5), '0\n1 2 3 4\n'.padEnd(80)), /a\.ply: it has 1 points, and its header promises 5\. The file is damaged.* again\.$/],
    [bytesOf(binary, Buffer.alloc(3 * 13)), /points cannot be read \(.*export it again/],
    [bytesOf(kPlyHeader('ascii', 4_000_000_000), '0\n'), /promises 4000000000 of vertex, and only 2 bytes/],
    [bytesOf(kPlyHeader('middle_endian', 5)), /line 'format middle_endian 1.0'/],
    [bytesOf('ply\nformat ascii 1.0\nelement face 0\nend_header\n'), /no element vertex/],
    [bytesOf(vertex('float x')), /no x, y and z of one type/],
    [bytesOf(vertex('int x', 'float y', 'float z')), /no x, y and z of one type/],
    [bytesOf(vertex('float x', 'float y', 'quad z')), /line 'property quad z'/],
    [bytesOf(vertex('float x', 'float y', 'float z'), 'two 3'), /contain 'w'/],
    [bytesOf('ply\nwhat is this\nend_header\n'), /line 'what is this'/],
    [bytesOf('ply\nformat ascii 1.0\n'), /no end_header/],
  ];
  for (const [bytes, expected] of cases) assert.throws(() => read('a.ply', bytes), expected);
});

test('raw scans are x y z intensity, or x y z where only that fits', () => {
  const kitti = read('000001.bin', floats([1, 2, 3, 0.5, 4, 5, 6, 0.5]));
  assert.deepEqual([[...kitti.positions], kitti.layout], [[1, 2, 3, 4, 5, 6], 'xyzi']);
  const bare = read('a.bin', floats([1, 2, 3]));
  assert.deepEqual([[...bare.positions], bare.layout], [[1, 2, 3], 'xyz']);
  assert.throws(() => read('a.bin', Buffer.alloc(17)), /17 bytes, which is not a multiple of 16/);
  assert.throws(() => read('a.bin', Buffer.alloc(0)), /0 bytes.*export it again/);
});

test('a file without a header that is not named .bin is no scan, and limits hold', () => {
  assert.throws(() => read('photo.jpg', floats([1, 2, 3, 4])), /photo\.jpg: it has neither a PCD nor a PLY header\. Choose/);
  assert.throws(() => read('a.bin', floats([1, 2, 3, 4, 5, 6, 7, 8]), { maxPoints: 1 }), /2 points, and at most 1 are allowed\. Choose/);
  assert.throws(() => checkSize({ name: 'map.pcd', size: 2e9 }), /map\.pcd: it has 2000000000 bytes.* Choose a single scan/);
});

import assert from 'node:assert/strict';
import { createRequire } from 'node:module';
import { test } from 'node:test';

const unit = (name) => import(`../../../web/dist/unit/${name}.js`);
const { asOnPage, choiceOf, undecided } = await unit('upload/topics');
const { chosenFile, fromDirectoryInput, topicsOf } = await unit('upload/chosen');
const { McapWriter } = createRequire(new URL('../../../web/package.json', import.meta.url))('@mcap/core');

const kCloud = 'sensor_msgs/msg/PointCloud2';
const kOdometry = 'nav_msgs/msg/Odometry';

/** @param topics [name, type, number of messages] @param options of the writer */
async function mcap(topics, options = {}) {
  const pieces = [];
  let size = 0n;
  const write = async (bytes) => {
    pieces.push(Buffer.from(bytes));
    size += BigInt(bytes.length);
  };
  const writer = new McapWriter({ writable: { write, position: () => size }, ...options });
  await writer.start({ profile: 'ros2', library: 'test' });
  for (const [topic, name, count] of topics) {
    const schemaId = await writer.registerSchema({ name, encoding: 'ros2msg', data: new Uint8Array() });
    const channelId = await writer.registerChannel({ schemaId, topic, messageEncoding: 'cdr', metadata: new Map() });
    for (let i = 0; i < count; ++i) {
      await writer.addMessage({ channelId, sequence: i, logTime: BigInt(i), publishTime: BigInt(i), data: new Uint8Array(1000) });
    }
  }
  await writer.end();
  return new Blob(pieces);
}

/** A record of a ROS 1 bag (wiki.ros.org/Bags/Format/2.0). */
function record(fields, data) {
  const header = Buffer.concat(Object.entries(fields).map(([name, value]) => {
    const field = Buffer.concat([Buffer.from(`${name}=`), value]);
    return Buffer.concat([u32(field.length), field]);
  }));
  return Buffer.concat([u32(header.length), header, u32(data.length), data]);
}
const u32 = (value) => Buffer.from(Uint32Array.of(value).buffer);
const u64 = (value) => Buffer.from(BigUint64Array.of(BigInt(value)).buffer);
const op = (value) => Buffer.from([value]);

/** A bag of one chunk whose messages are left out. @param topics [name, type, number of messages] */
function rosbag(topics) {
  const head = (at) => {
    const fields = { op: op(3), index_pos: u64(at), conn_count: u32(topics.length), chunk_count: u32(1) };
    return record(fields, Buffer.alloc(4096 - record(fields, Buffer.alloc(0)).length, ' '));
  };
  const magic = Buffer.from('#ROSBAG V2.0\n');
  const chunk = record({ op: op(5), compression: Buffer.from('none'), size: u32(3) }, Buffer.from('abc'));
  const at = magic.length + head(0).length;
  const connections = topics.map(([topic, type], conn) => record(
    { op: op(7), conn: u32(conn), topic: Buffer.from(topic) },
    record({ topic: Buffer.from(topic), type: Buffer.from(type), md5sum: Buffer.from('*'), message_definition: Buffer.from('x') }, Buffer.alloc(0)).subarray(4, -4)));
  const counts = Buffer.concat(topics.map(([, , count], conn) => Buffer.concat([u32(conn), u32(count)])));
  const info = record({ op: op(6), ver: u32(1), chunk_pos: u64(at), start_time: u64(0), end_time: u64(0), count: u32(topics.length) }, counts);
  return new Blob([magic, head(at + chunk.length), chunk, ...connections, info]);
}

const rows = (topics) => topics?.map(({ word, topic, type, messages }) => [word, topic, type, messages]);

test('topics are read from the index of an MCAP file, and nothing else of it', async () => {
  const file = await mcap([['/rear', kCloud, 2], ['/front', kCloud, 3], ['/odom', kOdometry, 9], ['/imu', 'sensor_msgs/msg/Imu', 9],
    ['/tf', 'tf2_msgs/msg/TFMessage', 1], ['/tf_static', 'tf2_msgs/msg/TFMessage', 1], ['/fix', 'sensor_msgs/msg/NavSatFix', 4], ['/none', kCloud, 0]]);
  let read = 0;
  const slice = file.slice.bind(file);
  file.slice = (begin, end) => {
    read += end - begin;
    return slice(begin, end);
  };
  assert.deepEqual(rows(await topicsOf([file])), [
    ['gnss', '/fix', 'sensor_msgs/msg/NavSatFix', 4], ['cloud', '/front', kCloud, 3], ['imu', '/imu', 'sensor_msgs/msg/Imu', 9], ['poses', '/odom', kOdometry, 9], ['cloud', '/rear', kCloud, 2],
    ['poses', '/tf', 'tf2_msgs/msg/TFMessage', 1]]);
  assert.ok(read < 8_000 && read < file.size / 2, `${read} of ${file.size} bytes`);
});

test('topics of the parts of a split recording are added up', async () => {
  assert.deepEqual(rows(await topicsOf([await mcap([['/a', kCloud, 2]]), await mcap([['/a', kCloud, 3], ['/b', kCloud, 1]])])),
    [['cloud', '/a', kCloud, 5], ['cloud', '/b', kCloud, 1]]);
});

test('topics of a ROS 1 bag come from its index, with the names of ROS 2', async () => {
  assert.deepEqual(rows(await topicsOf([rosbag([['/points', 'sensor_msgs/PointCloud2', 7], ['/tf', 'tf/tfMessage', 2], ['/odom', 'nav_msgs/Odometry', 1]])])),
    [['poses', '/odom', kOdometry, 1], ['cloud', '/points', kCloud, 7], ['poses', '/tf', 'tf2_msgs/msg/TFMessage', 2]]);
});

test('a file without an index, cut off or of another kind is left to the server', async () => {
  const whole = await mcap([['/a', kCloud, 2]]);
  for (const file of [await mcap([['/a', kCloud, 2]], { useStatistics: false }), whole.slice(0, whole.size >> 1), new Blob(['x']), new Blob([]),
    rosbag([['/a', 'sensor_msgs/PointCloud2', 7]]).slice(0, 4200), new Blob(['#ROSBAG V2.0\n'])]) {
    assert.equal(await topicsOf([file]), undefined);
  }
});

test('a chosen recording brings its topics along', async () => {
  const file = Object.assign(await mcap([['/a', kCloud, 2], ['/b', kCloud, 2]]), { name: 'run.mcap', lastModified: 0 });
  assert.deepEqual((await chosenFile(file)).topics.map(({ choice }) => choice), ['cloud=/a', 'cloud=/b']);
  assert.equal((await chosenFile(Object.assign(new Blob(['x']), { name: 'run.db3', lastModified: 0 }))).topics, undefined);
});

test('what has to be chosen is told by the topics', () => {
  const topic = (word, name, type, messages) => ({ word, topic: name, type, messages, choice: `${word}=${name}`, frame_id: '' });
  const clouds = [topic('cloud', '/a', kCloud, 100), topic('cloud', '/b', kCloud, 100)];
  const poses = [topic('poses', '/odom', kOdometry, 50), topic('poses', '/fused', 'geometry_msgs/msg/PoseStamped', 3)];
  const goals = [poses[0], { ...poses[1], messages: 2 }];
  assert.deepEqual(undecided([], {}), []);
  assert.deepEqual(undecided(clouds.slice(1), {}), []);
  assert.deepEqual(undecided(clouds, {}), ['cloud']);
  assert.deepEqual(undecided(clouds, { cloud: '/b' }), []);
  assert.deepEqual(undecided([...clouds, ...poses], { cloud: '/a' }), ['poses']);
  assert.deepEqual(undecided([...clouds, ...poses], { cloud: '/a', poses: 'none' }), []);
  assert.deepEqual(undecided([...clouds, ...goals], { cloud: '/a' }), [], 'goals are no poses');
  assert.deepEqual(undecided([clouds[0], poses[0], topic('poses', '/tf', 'tf2_msgs/msg/TFMessage', 9)], {}), [], 'the server compares tf with the topic');
  assert.equal(choiceOf({ gnss: '/fix', cloud: '/a', poses: '', pose_frame: ' base ' }), 'cloud=/a&pose_frame=base&gnss=/fix');
});

/** A chosen folder. @param files by name: their content */
const folder = (files) => fromDirectoryInput(Object.entries(files).map(([name, content]) =>
  Object.assign(content instanceof Blob ? content : new Blob([content]), { name, webkitRelativePath: `run/${name}`, lastModified: 0 })));

test('a folder with lidars.json asks for no topics, since its file chooses them', async () => {
  const bag = () => mcap([['/a', kCloud, 2], ['/b', kCloud, 2]]);
  assert.equal((await folder({ 'run.mcap': await bag(), 'lidars.json': '{}' })).topics, undefined);
  assert.equal((await folder({ 'run.mcap': await bag() })).topics.length, 2);
});

test('what topics.txt of a folder says is decided', async () => {
  const { topics, ownWords } = await folder({ 'run.mcap': await mcap([['/a', kCloud, 2], ['/b', kCloud, 2]]), 'topics.txt': 'imu=none\r\ncloud=/b\n' });
  assert.deepEqual(undecided(topics, {}), ['cloud']);
  assert.deepEqual(undecided(topics, {}, ownWords), []);
  assert.deepEqual(undecided(topics, {}, 'imu=none'), ['cloud']);
});

test('a choice of several lidars, with other words, of the topics that there are', () => {
  const topics = ['/a', '/b'].map((topic) => ({ word: 'cloud', topic, type: kCloud, messages: 9, choice: '', frame_id: '' }));
  assert.equal(choiceOf({ cloud: '/b,/a', other: ' stamps=recorded & points=map ' }, topics), 'cloud=/b,/a&stamps=recorded&points=map');
  assert.equal(choiceOf({ cloud: '/c', poses: '/odom', imu: 'none' }, topics), 'imu=none', 'topics of another file are left out');
  assert.equal(choiceOf({ cloud: '/a', other: 'cloud=/b' }, topics), 'cloud=/b', 'each word once');
  assert.deepEqual(undecided(topics, { other: 'cloud=/b' }), []);
  assert.deepEqual(undecided(topics, { cloud: '/c' }), ['cloud']);
});

test('what the server asks for is said in the words of the form', () => {
  assert.equal(asOnPage("drive 3: found clouds on /a, /b, expected one: give 'drive 3?cloud=/a'"),
    'drive 3: found clouds on /a, /b, expected one: give “cloud=/a”');
  assert.equal(asOnPage("give 'BAG?calibration=NAME', a file"), 'give “calibration=NAME”, a file');
  assert.equal(asOnPage("from 'map' to 'lidar': why?"), "from 'map' to 'lidar': why?");
});

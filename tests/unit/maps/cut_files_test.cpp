// What becomes of a file that was cut off, at every one of its bytes, for every reader: an error
// that names a file of the sample, or what can be read of it, never more than the whole; and little
// memory.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/labelled_boxes.hpp>
#include <stillmap/maps/scan_file.hpp>

#include <cctype>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <ostream>
#include <set>
#include <string>
#include <vector>

#include "scan_bytes.hpp"
#include "support/bag_bytes.hpp"
#include "support/las_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/peak_memory.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace cut_files_test {

namespace fs = std::filesystem;
using test::append;
using test::append_big_endian;
using test::LasBytes;
using test::McapBytes;
using test::xyzi;

constexpr double kMostMemoryMib = 256.0;
constexpr std::int64_t kStart = 1'700'000'000'000'000'000;
constexpr std::int64_t kStep = 100'000'000;
const char* const kCloudType = "sensor_msgs/msg/PointCloud2";
const char* const kOdometryType = "nav_msgs/msg/Odometry";
const char* const kTfType = "tf2_msgs/msg/TFMessage";

/// What was read: scans, points, poses, boxes.
struct Found {
  std::size_t count = 0;
  /// Whether less than all was said of, where the format lets that be known.
  bool said_of_loss = true;
};

struct Sample {
  std::string name;
  std::map<std::string, std::string> files;
  /// Which of them is cut.
  std::string cut;
  std::function<Found(const fs::path& root)> read;
  /// Of formats that count their bytes: what is cut is never read.
  bool needs_every_byte = false;
};

/// In the tests' names.
void PrintTo(const Sample& sample, std::ostream* out) { *out << sample.name; }

// ---- what is read

Found scan(const fs::path& file) { return {read_scan_file(file).points_in_file}; }

Found cloud(const fs::path& file) {
  std::size_t points = 0;
  (void)read_cloud_file(file, [&](std::span<const CloudPoint> some) { points += some.size(); });
  return {points};
}

/// Scans whose points can be read, of a drive and its poses.
Found drive(const fs::path& root) {
  const Drive opened = Drive::open(root);
  // Where the poses are from is said of whole ones, too.
  Found found{0, std::any_of(opened.contents().notes.begin(), opened.contents().notes.end(),
                             [](const std::string& note) {
                               return !note.starts_with("poses are those of");
                             })};
  for (std::size_t i = 0; i < opened.size(); ++i) {
    try {
      found.count += opened.read(i).points_in_file;
    } catch (const InputError&) {
      found.said_of_loss = true;
    }
  }
  return found;
}

/// As `drive`, of files in which a cut can be one between two lines.
Found lines_of_drive(const fs::path& root) { return {drive(root).count}; }

// ---- samples

using Files = std::map<std::string, std::string>;

Sample file_sample(const std::string& name, const std::string& bytes,
                   const std::function<Found(const fs::path&)>& read) {
  return {name, {{name, bytes}}, name, [=](const fs::path& root) { return read(root / name); }};
}

std::string pcd(const std::string& encoding, const std::string& body) {
  return "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity _ t\nSIZE 4 4 4 2 1 4\n"
         "TYPE F F F U U U\nCOUNT 1 1 1 1 2 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\n"
         "POINTS 3\nDATA " +
         encoding + "\n" + body;
}

std::string pcd_point(float x) {
  std::string bytes;
  for (const float value : {x, 2.0F, 3.0F}) append(bytes, value);
  append(bytes, std::uint16_t{700});
  bytes += "__";
  append(bytes, std::uint32_t{9});
  return bytes;
}

std::string pcd_columns() {
  std::string bytes;
  for (const float value : {1.F, 2.F, 3.F, 2.F, 2.F, 2.F, 3.F, 3.F, 3.F}) append(bytes, value);
  for (int i = 0; i < 3; ++i) append(bytes, std::uint16_t{700});
  for (int i = 0; i < 3; ++i) append(bytes, std::uint32_t{9});
  return bytes;
}

std::string ply(const std::string& encoding, const std::string& body) {
  return "ply\nformat " + encoding +
         " 1.0\nelement face 1\nproperty list uchar short ids\nelement vertex 2\n"
         "property float x\nproperty double y\nproperty short z\nend_header\n" +
         body;
}

template <bool big>
std::string ply_body() {
  std::string bytes;
  const auto put = [&](auto number) {
    big ? append_big_endian(bytes, number) : append(bytes, number);
  };
  put(std::uint8_t{2});
  put(std::int16_t{5});
  put(std::int16_t{6});
  for (const float x : {1.0F, 2.0F}) {
    put(x);
    put(2.0);
    put(std::int16_t{-3});
  }
  return bytes;
}

std::string las(std::uint8_t minor, std::uint8_t format) {
  LasBytes bytes;
  bytes.minor = minor;
  bytes.format = format;
  bytes.points.assign(3, {1, 2, 3, 4});
  bytes.records = {{"other", 7, "something"}};
  if (minor == 4) bytes.long_records = {{"other", 8, "something else"}};
  return bytes.bytes();
}

void add_clouds(std::vector<Sample>& samples) {
  samples.push_back(file_sample("a.bin", xyzi(1, 2, 3, 4) + xyzi(1, 2, 3, 4), scan));
  for (const auto& read : {scan, cloud}) {
    samples.push_back(file_sample(
        "ascii.pcd", pcd("ascii", "1 2 3 7 1 1 9\n2 2 3 7 1 1 9\n3 2 3 7 1 1 9\n"), read));
    samples.push_back(
        file_sample("binary.pcd", pcd("binary", pcd_point(1) + pcd_point(2) + pcd_point(3)), read));
    samples.push_back(
        file_sample("compressed.pcd",
                    pcd("binary_compressed", test::pcd_compressed_body(pcd_columns())), read));
    samples.push_back(file_sample("ascii.ply", ply("ascii", "3 0 1 2\n1 2 -3\n4.5 5 -6\n"), read));
    samples.push_back(
        file_sample("little.ply", ply("binary_little_endian", ply_body<false>()), read));
    samples.push_back(file_sample("big.ply", ply("binary_big_endian", ply_body<true>()), read));
  }
  for (const int minor : {2, 3, 4})
    samples.push_back(file_sample(fmt::format("1_{}.las", minor),
                                  las(static_cast<std::uint8_t>(minor), minor == 4 ? 6 : 3),
                                  cloud));
}

/// Binary files of points; and each name once, also of what is read as a scan and as a map.
void mark_clouds(std::vector<Sample>& samples) {
  std::set<std::string> names;
  for (Sample& sample : samples) {
    sample.needs_every_byte = sample.name != "a.bin" && !sample.name.starts_with("ascii");
    if (!names.insert(sample.name).second) sample.name += " as a map";
  }
}

struct Message {
  std::uint16_t topic = 1;
  std::string bytes;
};

/// Two clouds, poses around them and the lidar's place on the vehicle.
std::vector<Message> messages() {
  std::vector<Message> all{{3, test::transform(0, "base_link", "lidar", {0, 0, 1})}};
  for (int i = 0; i < 2; ++i) {
    const std::int64_t stamp_ns = kStart + i * kStep;
    all.push_back({2, test::odometry(stamp_ns, {1.0 * i, 0, 0})});
    all.push_back({1, test::one_point(stamp_ns, static_cast<float>(i + 1))});
  }
  all.push_back({2, test::odometry(kStart + 2 * kStep, {2, 0, 0})});
  return all;
}

/// @param chunked  each message in a chunk of its own, else none.
std::string mcap(bool chunked, const std::string& compression, bool indexed) {
  const std::string names = McapBytes::schema(1, kCloudType) + McapBytes::channel(1, 1, "/points") +
                            McapBytes::schema(2, kOdometryType) +
                            McapBytes::channel(2, 2, "/odom") + McapBytes::schema(3, kTfType) +
                            McapBytes::channel(3, 3, "/tf_static");
  McapBytes bytes;
  bytes.add(names);
  for (const Message& message : messages()) {
    const std::string record = McapBytes::message(message.topic, message.bytes);
    if (chunked) {
      bytes.add_chunk(record, compression, {message.topic});
    } else {
      bytes.add(record);
    }
  }
  return bytes.finished(indexed ? names : "");
}

std::string sqlite(bool packed) {
  const test::TemporaryFolder folder(test::memory_folder());
  const fs::path file = folder.path() / "run.db3";
  {
    test::SqliteFile bag(file);
    bag.run("PRAGMA page_size=512").make_tables(2);
    bag.topic(1, "/points", kCloudType).topic(2, "/odom", kOdometryType);
    bag.topic(3, "/tf_static", kTfType);
    for (const Message& message : messages())
      bag.message(message.topic, test::packed(message.bytes, packed ? "zstd" : ""));
  }
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void add_bags(std::vector<Sample>& samples) {
  samples.push_back(file_sample("plain.mcap", mcap(false, "", false), drive));
  for (const std::string compression : {"", "lz4", "zstd"})
    for (const bool indexed : {false, true})
      samples.push_back(
          file_sample(fmt::format("chunks_{}{}.mcap", compression, indexed ? "_indexed" : ""),
                      mcap(true, compression, indexed), drive));
  samples.push_back(file_sample("plain.db3", sqlite(false), drive));
  samples.push_back(file_sample("packed.db3", sqlite(true), drive));
  samples.push_back(file_sample("whole.db3.zstd", test::packed(sqlite(false), "zstd"), drive));
  samples.push_back(
      file_sample("whole.mcap.zstd", test::packed(mcap(true, "", true), "zstd"), drive));
  const Files folder{{"b.db3", sqlite(false)},
                     {"metadata.yaml",
                      "rosbag2_bagfile_information:\n  relative_file_paths:\n"
                      "    - b.db3\n  message_count: 10\n"},
                     {"topics.txt", "cloud=/points\nposes=/odom\n"}};
  for (const char* const cut : {"metadata.yaml", "topics.txt"})
    samples.push_back({cut, folder, cut, lines_of_drive});
}

void add_kitti(std::vector<Sample>& samples) {
  const std::string tr = "0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n";
  const Files odometry{{"velodyne/000000.bin", xyzi(1, 2, 3, 4)},
                       {"velodyne/000001.bin", xyzi(1, 2, 3, 4) + xyzi(1, 2, 3, 4)},
                       {"calib.txt", "P0: 7 0 6 0 0 7 1 0 0 0 1 0\nTr: " + tr},
                       {"poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n"},
                       {"times.txt", "0.0e+00\n1.037359e-01\n"},
                       {"labels/000000.label", std::string(4, '\0')},
                       {"labels/000001.label", std::string(8, '\0')}};
  for (const char* const cut : {"calib.txt", "poses.txt", "times.txt", "velodyne/000001.bin"})
    samples.push_back({std::string("odometry ") + cut, odometry, cut, lines_of_drive});
  samples.push_back({"labels", odometry, "labels/000001.label", [](const fs::path& root) {
                       return Found{Drive::open(root).read_labels(1).size()};
                     }});
  const std::string day = "2011_09_26/";
  const std::string raw = day + "drive/";
  const std::string stamps = "2011-09-26 13:00:10.000000000\n2011-09-26 13:00:10.100000000\n";
  std::string packet = "49.0 8.4 110 0 0 1.5";
  for (int i = 6; i < 30; ++i) packet += " 0";
  const Files of_raw{{day + "calib_imu_to_velo.txt", "R: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n"},
                     {raw + "velodyne_points/data/0000000000.bin", xyzi(1, 2, 3, 4)},
                     {raw + "velodyne_points/data/0000000001.bin", xyzi(1, 2, 3, 4)},
                     {raw + "velodyne_points/timestamps.txt", stamps},
                     {raw + "velodyne_points/timestamps_start.txt", stamps},
                     {raw + "velodyne_points/timestamps_end.txt", stamps},
                     {raw + "oxts/timestamps.txt", stamps},
                     {raw + "oxts/data/0000000000.txt", packet},
                     {raw + "oxts/data/0000000001.txt", packet}};
  for (const auto& [cut, bytes] : of_raw)
    samples.push_back({"raw " + cut, of_raw, cut,
                       [=](const fs::path& root) { return lines_of_drive(root / raw); }});
}

void add_mulran(std::vector<Sample>& samples) {
  const std::string scan_name = "Ouster/1561000444390857630.bin";
  std::string poses;
  for (const char* const stamp : {"1561000444350857630", "1561000444450857630"})
    poses += std::string(stamp) + ",1,0,0,10.5,0,1,0,20.5,0,0,1,30.5\n";
  const Files files{{scan_name, xyzi(1, 2, 3, 4)}, {"global_pose.csv", poses}};
  for (const auto& [cut, bytes] : files)
    samples.push_back({"mulran " + cut, files, cut, lines_of_drive});
}

void add_poses_and_boxes(std::vector<Sample>& samples) {
  const std::string tum =
      "# stamp tx ty tz qx qy qz qw\n1700000000.0 0 0 0 0 0 0 1\n"
      "1700000000.1 1.25 0 0 0 0 0 1\n";
  const Files scans{{"a.bin", xyzi(1, 2, 3, 4)}, {"b.bin", xyzi(1, 2, 3, 4)}, {"path.tum", tum}};
  samples.push_back({"path.tum", scans, "path.tum", lines_of_drive});
  const std::string csv =
      "timestamp [ns],x [m],y,z,roll_deg,pitch_deg,yaw_deg,note\n"
      "1700000000000000000,0,0,0,0,0,90,\n1700000000100000000,1.25,0,0,0,0,90,b\n";
  const std::string g2o =
      "FIX 0\nVERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1.25 0 0 0 0 0 1\n"
      "EDGE_SE3:QUAT 0 1 1.25 0 0 0 0 0 1\n";
  samples.push_back({"poses.csv",
                     {{"a.bin", xyzi(1, 2, 3, 4)}, {"b.bin", xyzi(1, 2, 3, 4)}, {"poses.csv", csv}},
                     "poses.csv",
                     lines_of_drive});
  samples.push_back({"graph.g2o",
                     {{"0.bin", xyzi(1, 2, 3, 4)}, {"1.bin", xyzi(1, 2, 3, 4)}, {"a.g2o", g2o}},
                     "a.g2o",
                     lines_of_drive});
  const std::string car = "Car 0.1 0 0.0 10 20 30 40 1.5 1.6 4.0 2.0 1.6 9.7 0.3\n";
  const Files boxes{
      {"calib.txt",
       "P2: 721.5377 0 600 0 0 721.5377 170 0 0 0 1 0\nR0_rect: 1 0 0 0 1 0 0 0 1\n"
       "Tr_velo_to_cam: 0 -1 0 0  0 0 -1 -0.1  1 0 0 -0.3\n"},
      {"label.txt", "0 1 " + car + "1 1 " + car},
      {"boxes.json",
       R"({"format":"stillmap-boxes","version":1,"scans":[{"scan":0,"boxes":[{"centre":[1,2,3],)"
       R"("size":[4,2,1.5],"yaw":0.5,"class":"car","score":1,"track":-1}]}]})"}};
  const auto count = [](const fs::path& file) {
    Found found;
    for (const auto& [number, of_scan] : read_boxes(file, 10).by_scan)
      found.count += of_scan.size();
    return found;
  };
  for (const char* const cut : {"calib.txt", "label.txt"})
    samples.push_back({std::string("tracking ") + cut, boxes, cut,
                       [=](const fs::path& root) { return count(root / "label.txt"); }});
  samples.push_back({"boxes.json", boxes, "boxes.json",
                     [=](const fs::path& root) { return count(root / "boxes.json"); }});
}

std::vector<Sample> all_samples() {
  std::vector<Sample> samples;
  add_clouds(samples);
  mark_clouds(samples);
  add_bags(samples);
  add_kitti(samples);
  add_mulran(samples);
  add_poses_and_boxes(samples);
  return samples;
}

// ---- the rule

class CutFiles : public ::testing::TestWithParam<Sample> {
 protected:
  CutFiles() {
    for (const auto& [name, bytes] : GetParam().files) folder_.write(name, bytes);
  }
  [[nodiscard]] Found read() const { return GetParam().read(folder_.path()); }
  /// @return nothing for an error, which names a file.
  [[nodiscard]] std::optional<Found> read_or_error() const {
    try {
      return read();
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), ::testing::HasSubstr(folder_.path().string()));
    } catch (const StorageError& error) {
      EXPECT_THAT(error.what(), ::testing::HasSubstr(folder_.path().string()));
    }
    return std::nullopt;
  }
  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_P(CutFiles, AreAnErrorOrWhatIsThereOfThem) {
  const Sample& sample = GetParam();
  const std::string whole = sample.files.at(sample.cut);
  const std::size_t most = read().count;
  test::forget_peak_memory();
  for (std::size_t size = 0; size < whole.size(); ++size) {
    SCOPED_TRACE(size);
    folder_.write(sample.cut, whole.substr(0, size));
    const std::optional<Found> found = read_or_error();
    if (!found) continue;
    ASSERT_FALSE(sample.needs_every_byte);
    ASSERT_LE(found->count, most);
    ASSERT_TRUE(found->count == most || found->said_of_loss);
  }
#if !defined __SANITIZE_ADDRESS__ && !defined __SANITIZE_THREAD__
  EXPECT_LT(test::peak_memory_mib(), kMostMemoryMib);
#endif
}

INSTANTIATE_TEST_SUITE_P(OfEveryReader, CutFiles, ::testing::ValuesIn(all_samples()),
                         [](const auto& tested) {
                           std::string name = fmt::format("{}_{}", tested.index, tested.param.name);
                           for (char& c : name)
                             if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
                           return name;
                         });

}  // namespace cut_files_test
}  // namespace stillmap::maps

// Time and memory of readers against the size of what they read: sixteen times the items take at
// most 36 times as long (with the square it were 256), and memory stays below a fixed multiple of
// the bytes.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/imu.hpp>
#include <stillmap/maps/pose_file.hpp>

#include <algorithm>
#include <ctime>
#include <functional>
#include <ostream>
#include <string>

#include "formats/nmea.hpp"
#include "support/bag_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/peak_memory.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace reader_growth_test {

namespace fs = std::filesystem;
using test::McapBytes;
using test::MessageBytes;

constexpr std::int64_t kFirstNs = 1'700'000'000'000'000'000;
constexpr std::int64_t kPeriodNs = 10'000'000;
constexpr std::size_t kTimesTheItems = 16;
constexpr double kMostGrowth = 36.0;
constexpr double kMostMemoryPerByte = 16.0;
constexpr double kFreeMemoryMib = 16.0;

struct Reader {
  std::string name;
  /// Of the smaller file.
  std::size_t items = 0;
  std::function<std::string(std::size_t items)> make;
  /// @return how many items it found.
  std::function<std::size_t(const fs::path& file)> read;
};

/// In the tests' names.
void PrintTo(const Reader& reader, std::ostream* out) { *out << reader.name; }

std::string pose_csv(std::size_t rows) {
  std::string text = "timestamp [ns],x [m],y [m],z [m],roll_deg,pitch_deg,yaw_deg\n";
  for (std::size_t i = 0; i < rows; ++i)
    text += fmt::format("{},{}.25,2.5,0.125,0.5,0.25,{}\n",
                        kFirstNs + static_cast<std::int64_t>(i) * kPeriodNs, i, i % 360);
  return text;
}

std::string g2o(std::size_t vertices) {
  std::string text;
  for (std::size_t i = 0; i < vertices; ++i)
    text += fmt::format(
        "VERTEX_SE3:QUAT {0} {0}.25 0 0 0 0 0 1\nEDGE_SE3:QUAT {0} {1} 1 0 0 0 0 0 1 1 0 0 0 0 0 1 "
        "0 0 0 0 1 0 0 0 1 0 0 1 0 1\n",
        i, i + 1);
  return text;
}

std::string nmea(std::size_t fixes) {
  std::string text;
  for (std::size_t i = 0; i < fixes; ++i) {
    const std::string sentence =
        fmt::format("GPGGA,{:02}{:02}{:02}.{:02},4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,",
                    i / 360'000 % 24, i / 6000 % 60, i / 100 % 60, i % 100);
    unsigned sum = 0;
    for (const char c : sentence) sum ^= static_cast<unsigned char>(c);
    text += fmt::format("${}*{:02X}\r\n", sentence, sum);
  }
  return text;
}

std::string imu_csv(std::size_t readings) {
  std::string text = "stamp_ns,wx,wy,wz,ax,ay,az\n";
  for (std::size_t i = 0; i < readings; ++i)
    text += fmt::format("{},0.01,-0.02,0.{},0.1,0.2,9.8\n",
                        kFirstNs + static_cast<std::int64_t>(i) * kPeriodNs, i % 10);
  return text;
}

/// A bag of one topic. @param message  of a stamp.
std::string bag(const std::string& type, std::size_t messages,
                const std::function<std::string(std::int64_t stamp_ns)>& message) {
  McapBytes bytes;
  const std::string names = McapBytes::schema(1, type) + McapBytes::channel(1, 1, "/points");
  bytes.add(names);
  for (std::size_t i = 0; i < messages; ++i)
    bytes.add(McapBytes::message(1, message(kFirstNs + static_cast<std::int64_t>(i) * kPeriodNs)));
  return bytes.finished(names);
}

std::string livox(std::int64_t stamp_ns) {
  constexpr std::uint32_t kPoints = 20;
  MessageBytes message;
  message.header(stamp_ns, "livox").put(static_cast<std::uint64_t>(stamp_ns)).put(kPoints);
  for (int i = 0; i < 4; ++i) message.put(std::uint8_t{0});
  message.put(kPoints);
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    message.put(i * 1000).put(4.0F).put(2.0F).put(-1.0F);
    message.put(std::uint8_t{77}).put(std::uint8_t{0}).put(std::uint8_t{5});
  }
  return message.str();
}

/// One packet of a VLP-16.
std::string velodyne(std::int64_t stamp_ns) {
  MessageBytes message;
  message.header(stamp_ns, "velodyne").put(std::uint32_t{1});
  message.put(static_cast<std::int32_t>(stamp_ns / 1'000'000'000));
  message.put(static_cast<std::uint32_t>(stamp_ns % 1'000'000'000));
  std::string packet;
  for (int block = 0; block < 12; ++block) {
    packet += std::string("\xff\xee", 2) + std::string{static_cast<char>(20 * block), '\0'};
    for (int laser = 0; laser < 32; ++laser) packet += std::string("\x88\x13\x07", 3);
  }
  packet.resize(1204, '\0');
  packet += "\x37\x22";
  for (const char byte : packet) message.put(byte);
  return message.str();
}

std::size_t scans_with_points(const fs::path& file) {
  const Drive drive = Drive::open(file);
  std::size_t found = 0;
  for (std::size_t i = 0; i < drive.size(); ++i) found += drive.read(i).cloud.empty() ? 0 : 1;
  return found;
}

std::vector<Reader> readers() {
  const auto poses = [](const fs::path& file) { return read_pose_file(file).all().size(); };
  return {
      {"pose_csv", 1000, pose_csv, poses},
      {"g2o", 1000, g2o, poses},
      {"nmea", 1000, nmea,
       [](const fs::path& file) {
         std::size_t fixes = 0;
         (void)read_nmea(file, 0, [&](const NmeaFix&) { ++fixes; });
         return fixes;
       }},
      {"imu_csv", 1000, imu_csv, [](const fs::path& file) { return read_imu_csv(file).size(); }},
      {"livox_bag", 100,
       [](std::size_t messages) { return bag("livox_ros_driver2/msg/CustomMsg", messages, livox); },
       scans_with_points},
      {"velodyne_bag", 100,
       [](std::size_t messages) {
         return bag("velodyne_msgs/msg/VelodyneScan", messages, velodyne);
       },
       scans_with_points},
  };
}

class ReaderGrowth : public ::testing::TestWithParam<Reader> {
 protected:
  /// Least processor time of three readings [s].
  [[nodiscard]] double reading_s(const fs::path& file) const {
    double least_s = 1e9;
    for (int i = 0; i < 3; ++i) {
      const std::clock_t began = std::clock();
      static_cast<void>(GetParam().read(file));
      least_s = std::min(least_s, static_cast<double>(std::clock() - began) / CLOCKS_PER_SEC);
    }
    return least_s;
  }
  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_P(ReaderGrowth, IsLinear) {
#if defined __SANITIZE_ADDRESS__ || defined __SANITIZE_THREAD__
  GTEST_SKIP() << "the sanitizer takes most of the time and memory";
#endif
  const Reader& reader = GetParam();
  const bool is_bag = reader.name.ends_with("bag");
  const fs::path small =
      folder_.write(is_bag ? "small.mcap" : "small.txt", reader.make(reader.items));
  const fs::path large = folder_.write(is_bag ? "large.mcap" : "large.txt",
                                       reader.make(kTimesTheItems * reader.items));
  ASSERT_EQ(reader.read(small), reader.items);
  test::forget_peak_memory();
  const double before_mib = test::peak_memory_mib();
  ASSERT_EQ(reader.read(large), kTimesTheItems * reader.items);
  const double large_mib = static_cast<double>(fs::file_size(large)) / (1024.0 * 1024.0);
  EXPECT_LT(test::peak_memory_mib() - before_mib, kFreeMemoryMib + kMostMemoryPerByte * large_mib);
  // A busy machine may disturb a measurement; time that grows with the square fails each of them.
  double growth = 0.0;
  for (int i = 0; i < 12; ++i) {
    growth = reading_s(large) / std::max(reading_s(small), 1e-4);
    if (growth < kMostGrowth) return;
  }
  FAIL() << kTimesTheItems << " times the items take " << growth << " times as long";
}

INSTANTIATE_TEST_SUITE_P(OfFieldFormats, ReaderGrowth, ::testing::ValuesIn(readers()),
                         [](const auto& tested) { return tested.param.name; });

}  // namespace reader_growth_test
}  // namespace stillmap::maps

// Reading an MCAP file, beside reading its bytes: the ratio, and the memory that it takes. Times
// are of the CPU. usage: bag_bench FILE [--gigabytes G] [--packed lz4|zstd]
//
// FILE is made where there is none: clouds of 60,000 points of 24 bytes (x y z intensity, t, ring),
// a chunk with CRC-32 each, poses between them. Both passes find the file in the page cache as far
// as it fits; run it twice.
#include "support/bag_bytes.hpp"
#include "support/message_bytes.hpp"

#include <stillmap/maps/drive.hpp>

#include <fcntl.h>
#include <fmt/core.h>
#include <sys/resource.h>
#include <unistd.h>
#include <zlib.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace {

using namespace stillmap;
using test::McapBytes;

constexpr std::uint32_t kPoints = 60'000;

/// Of this process: who shares the cores does not count.
double now_cpu_s() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double peak_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

test::CloudMessage make_cloud() {
  test::CloudMessage cloud;
  cloud.fields = {{"x", 0}, {"y", 4}, {"z", 8}, {"intensity", 12}, {"t", 16, 6}, {"ring", 20, 4}};
  cloud.width = kPoints;
  cloud.point_step = 24;
  cloud.row_step = 24 * kPoints;
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const auto value = static_cast<float>(i);
    const float xyzi[4] = {value * 0.001F + 1.0F, value * 0.0005F, -1.5F, 0.25F};
    const std::uint32_t time_and_ring[2] = {i * 1500, i % 64};
    cloud.data.append(reinterpret_cast<const char*>(xyzi), sizeof(xyzi));
    cloud.data.append(reinterpret_cast<const char*>(time_and_ring), sizeof(time_and_ring));
  }
  return cloud;
}

/// A chunk of one cloud and the poses behind it. The points are the same in all of them, so that
/// 20 GB do not cost 20 GB of CRC.
class ChunkWriter {
 public:
  ChunkWriter() : points_crc_(McapBytes::crc(cloud_.data)) {}

  /// @return bytes written.
  std::size_t write(std::ostream& out, std::int64_t stamp_ns, const std::string& poses) {
    cloud_.stamp_ns = stamp_ns;
    const std::string points = std::exchange(cloud_.data, {});
    std::string head = cloud_.str();
    cloud_.data = points;
    // What follows the points: their count, then is_dense.
    const std::string tail = head.substr(head.size() - 1) + poses;
    head.resize(head.size() - 1);
    put_at(head, head.size() - 4, static_cast<std::uint32_t>(points.size()));
    head = McapBytes::message(1, head);
    const std::uint64_t message_bytes = head.size() - 9 + points.size() + 1;
    put_at(head, 1, message_bytes);
    const std::uint64_t records = head.size() + points.size() + tail.size();
    std::string begin = McapBytes::chunk("", "");
    put_at(begin, 1, std::uint64_t{begin.size() - 9 + records});
    put_at(begin, 9 + 16, records);
    put_at(begin, 9 + 24, crc_of(head, points.size(), tail));
    put_at(begin, begin.size() - 8, records);
    out << begin << head << points << tail;
    return begin.size() + records;
  }

 private:
  template <typename Number>
  static void put_at(std::string& bytes, std::size_t place, Number number) {
    std::memcpy(&bytes.at(place), &number, sizeof number);
  }
  [[nodiscard]] std::uint32_t crc_of(const std::string& head, std::size_t points,
                                     const std::string& tail) const {
    const auto with_points =
        ::crc32_combine(McapBytes::crc(head), points_crc_, static_cast<long>(points));
    return static_cast<std::uint32_t>(
        ::crc32_combine(with_points, McapBytes::crc(tail), static_cast<long>(tail.size())));
  }

  test::CloudMessage cloud_ = make_cloud();
  std::uint32_t points_crc_;
};

void make_bag(const std::filesystem::path& file, double gigabytes, const std::string& packed) {
  const std::string names =
      McapBytes::schema(1, "sensor_msgs/msg/PointCloud2") + McapBytes::channel(1, 1, "/points") +
      McapBytes::schema(2, "nav_msgs/msg/Odometry") + McapBytes::channel(2, 2, "/odom");
  std::ofstream out(file, std::ios::binary);
  const std::string head = McapBytes().add(names).data();
  out << head;
  ChunkWriter plain;
  test::CloudMessage cloud = make_cloud();
  cloud.stamp_ns = 1'700'000'000'000'000'000;
  for (double bytes = 0.0; bytes < gigabytes * 1e9; cloud.stamp_ns += 100'000'000) {
    std::string poses;
    for (int i = 0; i < 10; ++i)
      poses += McapBytes::message(
          2, test::odometry(cloud.stamp_ns + i * 10'000'000, {bytes * 1e-7, 0, 0}, "lidar"));
    if (packed.empty()) {
      bytes += static_cast<double>(plain.write(out, cloud.stamp_ns, poses));
      continue;
    }
    const std::string chunk = McapBytes::chunk(McapBytes::message(1, cloud.str()) + poses, packed);
    out << chunk;
    bytes += static_cast<double>(chunk.size());
  }
  out << McapBytes().finished().substr(McapBytes().data().size());
  if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

/// CPU seconds to read all bytes once, in pieces of 1 MiB.
double read_bytes_s(const std::filesystem::path& file) {
  const double begin_s = now_cpu_s();
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  std::vector<char> piece(1U << 20U);
  while (::read(descriptor, piece.data(), piece.size()) > 0) continue;
  ::close(descriptor);
  return now_cpu_s() - begin_s;
}

}  // namespace

int main(int count, char** words) {
  std::filesystem::path file;
  double gigabytes = 2.0;
  std::string packed;
  CLI::App app("Speed and memory of reading a bag");
  app.add_option("FILE", file)->required();
  app.add_option("--gigabytes", gigabytes)->capture_default_str();
  app.add_option("--packed", packed)->check(CLI::IsMember({"lz4", "zstd"}));
  CLI11_PARSE(app, count, words);
  if (!std::filesystem::exists(file)) make_bag(file, gigabytes, packed);
  const double megabytes = static_cast<double>(std::filesystem::file_size(file)) * 1e-6;
  const double before_mib = peak_mib();
  const double bytes_s = read_bytes_s(file);
  const double begin_s = now_cpu_s();
  const maps::Drive drive = maps::Drive::open(file);
  const double opened_s = now_cpu_s();
  std::size_t points = 0;
  for (std::size_t i = 0; i < drive.size(); ++i) points += drive.read(i).cloud.size();
  const double scans_s = now_cpu_s() - opened_s;
  fmt::print("file          {:.0f} MB, {} scans, {} points\n", megabytes, drive.size(), points);
  fmt::print("bytes alone   {:.0f} MB/s\n", megabytes / bytes_s);
  fmt::print("opened in     {:.2f} s of CPU\n", opened_s - begin_s);
  fmt::print("scans         {:.0f} MB/s, {:.0f} with opening\n", megabytes / scans_s,
             megabytes / (scans_s + opened_s - begin_s));
  fmt::print("ratio         {:.2f} of the time of bytes alone\n", scans_s / bytes_s);
  fmt::print("peak memory   {:.0f} MiB, {:.0f} before\n", peak_mib(), before_mib);
  return 0;
}

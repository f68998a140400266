#include "output/file_output.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <system_error>
#include <utility>
#include <vector>

namespace stillmap::simulation {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie");

void make_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw maps::StorageError(folder.string(), error.message());
}

void write_file(const std::filesystem::path& file, std::span<const std::byte> bytes) {
  TextFile whole(file);
  whole.append({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  whole.close();
}

void write_file(const std::filesystem::path& file, std::string_view text) {
  write_file(file, std::as_bytes(std::span(text)));
}

TextFile::TextFile(std::filesystem::path file)
    : file_(std::move(file)), stream_(file_, std::ios::binary) {
  if (!stream_) throw maps::StorageError(file_.string(), std::strerror(errno));
}

void TextFile::append(std::string_view text) {
  stream_.write(text.data(), static_cast<std::streamsize>(text.size()));
  if (!stream_) throw maps::StorageError(file_.string(), std::strerror(errno));
}

void TextFile::close() {
  // A full disk may show only when the buffer goes out.
  stream_.close();
  if (!stream_) throw maps::StorageError(file_.string(), std::strerror(errno));
}

void write_bin(const std::filesystem::path& file, std::span<const Eigen::Vector3f> positions,
               std::span<const float> intensities) {
  std::vector<Eigen::Vector4f> points;
  points.reserve(positions.size());
  for (std::size_t i = 0; i < positions.size(); ++i) {
    points.emplace_back(positions[i].x(), positions[i].y(), positions[i].z(), intensities[i]);
  }
  write_file(file, std::as_bytes(std::span(points)));
}

std::int64_t nanoseconds_of(double time_s) { return std::llround(1e9 * time_s); }

std::string kitti_row_of(const Eigen::Isometry3d& T) {
  std::string row;
  for (Eigen::Index r = 0; r < 3; ++r) {
    for (Eigen::Index c = 0; c < 4; ++c) {
      row += fmt::format("{}{:.12e}", row.empty() ? "" : " ", T(r, c));
    }
  }
  return row;
}

std::string tum_line_of(std::int64_t stamp_ns, const Eigen::Isometry3d& T) {
  constexpr std::int64_t kSecondNs = 1'000'000'000;
  const std::int64_t size_ns = std::abs(stamp_ns);
  const Eigen::Vector3d t = T.translation();
  const Eigen::Quaterniond q(T.linear());
  return fmt::format("{}{}.{:09} {:.9f} {:.9f} {:.9f} {:.12f} {:.12f} {:.12f} {:.12f}\n",
                     stamp_ns < 0 ? "-" : "", size_ns / kSecondNs, size_ns % kSecondNs, t.x(),
                     t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
}

}  // namespace stillmap::simulation

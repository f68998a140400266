#pragma once

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::simulation {

/// Makes a folder and those above it. @throws maps::StorageError.
void make_folder(const std::filesystem::path& folder);

/// Writes a whole file. @throws maps::StorageError naming it and the system's reason.
void write_file(const std::filesystem::path& file, std::span<const std::byte> bytes);
void write_file(const std::filesystem::path& file, std::string_view text);

/// Adds a number's own bytes.
template <typename Number>
void append(std::string& bytes, const Number& number) {
  bytes.append(reinterpret_cast<const char*>(&number), sizeof(number));
}

/// A text file that grows piece by piece.
class TextFile {
 public:
  /// @throws maps::StorageError, as do all members.
  explicit TextFile(std::filesystem::path file);
  void append(std::string_view text);
  void close();

 private:
  std::filesystem::path file_;
  std::ofstream stream_;
};

/// Points as little-endian float32 x y z intensity, KITTI's `.bin`.
/// @param intensities  one a point.
void write_bin(const std::filesystem::path& file, std::span<const Eigen::Vector3f> positions,
               std::span<const float> intensities);

/// Nearest whole number of nanoseconds.
[[nodiscard]] std::int64_t nanoseconds_of(double time_s);

/// 3 x 4 row-major, 12 digits, spaces between: KITTI's way to write a pose.
[[nodiscard]] std::string kitti_row_of(const Eigen::Isometry3d& T);

/// A line of a TUM file: `stamp tx ty tz qx qy qz qw`, stamp in seconds with 9 decimals.
[[nodiscard]] std::string tum_line_of(std::int64_t stamp_ns, const Eigen::Isometry3d& T);

}  // namespace stillmap::simulation

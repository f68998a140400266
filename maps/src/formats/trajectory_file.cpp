#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <memory>
#include <system_error>

#include <stillmap/maps/text.hpp>
#include "core/pose_bounds.hpp"
#include "formats/pose_line.hpp"

namespace stillmap::maps {
namespace {

void check_position(const std::filesystem::path& file, std::size_t line, const Eigen::Vector3d& t) {
  if (t.cwiseAbs().maxCoeff() <= kMaxPositionM) return;
  throw InputError(place(file, line),
                   fmt::format("a position of {:.3g} m", t.cwiseAbs().maxCoeff()),
                   fmt::format("at most {:g} m on each axis: write positions from an origin nearby",
                               kMaxPositionM));
}

/// Seconds with 9 decimals, by integers: a double has no room for them.
std::string stamp_text(std::int64_t stamp_ns) {
  constexpr std::uint64_t kSecond = 1'000'000'000;
  const std::uint64_t size = stamp_ns < 0 ? 0 - static_cast<std::uint64_t>(stamp_ns)
                                          : static_cast<std::uint64_t>(stamp_ns);
  return fmt::format("{}{}.{:09}", stamp_ns < 0 ? "-" : "", size / kSecond, size % kSecond);
}

}  // namespace

Eigen::Isometry3d pose_of_quaternion(const std::filesystem::path& file, std::size_t line,
                                     std::span<const double, 7> n) {
  const Eigen::Quaterniond q(n[6], n[3], n[4], n[5]);
  if (!(std::abs(q.norm() - 1.0) <= kMaxOffRotation)) {
    throw InputError(
        place(file, line), fmt::format("a quaternion of norm {:.6g}", q.norm()),
        "norm 1: check that qx qy qz qw stand in the order of the format, and normalize them");
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = q.normalized().toRotationMatrix();
  T.translation() << n[0], n[1], n[2];
  check_position(file, line, T.translation());
  return T;
}

Eigen::Isometry3d pose_of_matrix(const std::filesystem::path& file, std::size_t line,
                                 std::span<const double, 12> n) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() << n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10];
  T.translation() << n[3], n[7], n[11];
  check_position(file, line, T.translation());
  const Eigen::Matrix3d R = T.linear();
  const double off = (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off <= kMaxOffRotation) || R.determinant() < 0.0) {
    throw InputError(place(file, line), fmt::format("a 3x3 part {:.3g} off a rotation", off),
                     "a rotation R: write the lines as the 3x4 matrix [R t], row by row");
  }
  return renormalized(T);
}

Eigen::Isometry3d parse_kitti_pose(const std::filesystem::path& file, const NumberLine& line) {
  std::array<double, 12> n{};
  parse_finite(file, line, n);
  return pose_of_matrix(file, line.line, n);
}

void write_tum_trajectory(const std::filesystem::path& file, const Trajectory& trajectory) {
  fmt::memory_buffer text;
  for (const StampedPose& pose : trajectory.poses()) {
    const Eigen::Vector3d& t = pose.T_map_lidar.translation();
    const Eigen::Quaterniond q(pose.T_map_lidar.linear());
    fmt::format_to(std::back_inserter(text),
                   "{} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g}\n",
                   stamp_text(pose.stamp_ns), t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
  }
  errno = 0;
  std::FILE* stream = std::fopen(file.c_str(), "wb");
  bool good = stream != nullptr;
  good = good && std::fwrite(text.data(), 1, text.size(), stream) == text.size();
  // Closed in any case; a full disk may show up only there.
  if (stream != nullptr) good = (std::fclose(stream) == 0) && good;
  if (!good) throw StorageError(file.string(), std::generic_category().message(errno));
}

}  // namespace stillmap::maps

#include <stillmap/mapping/deskew.hpp>
#include <stillmap/maps/frames.hpp>

namespace stillmap::mapping {
namespace {

/// Beyond this the speed between two neighbours says nothing about the speed during a sweep [s].
constexpr double kMaxNeighbourGapS = 2.0;

}  // namespace

std::optional<Eigen::Matrix<double, 6, 1>> twist_at(const maps::Drive& drive, std::size_t index) {
  if (!drive.has_poses() || drive.size() < 2 || index >= drive.size()) return std::nullopt;
  const auto gap_s = [&](std::size_t a, std::size_t b) {
    return 1e-9 * static_cast<double>(drive.stamp_ns(b) - drive.stamp_ns(a));
  };
  std::size_t before = index;
  std::size_t after = index;
  if (index > 0 && gap_s(index - 1, index) <= kMaxNeighbourGapS) before = index - 1;
  if (index + 1 < drive.size() && gap_s(index, index + 1) <= kMaxNeighbourGapS) after = index + 1;
  const double span_s = gap_s(before, after);
  if (!(span_s > 0.0)) return std::nullopt;
  // A constant twist is the same seen from any pose of its path, so this holds at `index` too.
  const Eigen::Isometry3d T_before_after =
      drive.T_map_lidar(before).inverse() * drive.T_map_lidar(after);
  return Eigen::Matrix<double, 6, 1>(maps::log_se3(T_before_after) / span_s);
}

}  // namespace stillmap::mapping

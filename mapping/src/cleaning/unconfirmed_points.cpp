#include "cleaning/unconfirmed_points.hpp"

#include <algorithm>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kNeighbours = 8;
/// Around a point, as neighbours look at it [m].
constexpr float kConfirmedRadiusM = 0.06F;

}  // namespace

std::vector<std::uint8_t> find_unconfirmed_points(std::span<const Eigen::Vector3f> positions,
                                                  const std::vector<bool>& doubtful,
                                                  std::size_t scan, const PosedViews& views) {
  std::vector<std::uint8_t> flags(doubtful.begin(), doubtful.end());
  if (doubtful.empty()) return flags;
  const std::size_t begin = scan - std::min(scan, kNeighbours);
  const std::size_t end = std::min(scan + kNeighbours + 1, views.T_local_lidar.size());
  for (std::size_t other = begin; other < end; ++other) {
    if (other == scan) continue;
    const auto view = views.read(other);
    const Eigen::Isometry3f T_other_lidar =
        (views.T_local_lidar[other].inverse() * views.T_local_lidar[scan]).cast<float>();
    for (std::size_t i = 0; i < flags.size(); ++i) {
      if (flags[i] != 0 &&
          view->look(T_other_lidar * positions[i], kConfirmedRadiusM).sight == Sight::kHit)
        flags[i] = 0;
    }
  }
  return flags;
}

}  // namespace stillmap::mapping

#include "odometry/loam/thinned_features.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

namespace stillmap::mapping::loam {

std::vector<Feature> thinned(const std::vector<Feature>& features, double voxel_m) {
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keyed;
  keyed.reserve(features.size());
  for (std::size_t i = 0; i < features.size(); ++i) {
    // Within kMaxRangeM of the sensor, so 21 bits an axis are plenty.
    const Eigen::Array3f v =
        (features[i].position / static_cast<float>(voxel_m)).array().floor() + 1048576.0F;
    keyed.emplace_back((static_cast<std::uint64_t>(v.x()) << 42) |
                           (static_cast<std::uint64_t>(v.y()) << 21) |
                           static_cast<std::uint64_t>(v.z()),
                       static_cast<std::uint32_t>(i));
  }
  std::sort(keyed.begin(), keyed.end());
  std::vector<std::uint32_t> kept;
  for (std::size_t k = 0; k < keyed.size(); ++k) {
    if (k == 0 || keyed[k].first != keyed[k - 1].first) kept.push_back(keyed[k].second);
  }
  std::sort(kept.begin(), kept.end());
  std::vector<Feature> out;
  out.reserve(kept.size());
  for (const std::uint32_t i : kept) out.push_back(features[i]);
  return out;
}

}  // namespace stillmap::mapping::loam

#include "ground/reflected_noise.hpp"

#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap::mapping {
namespace {

/// Depth below the plane [m], from the authors' program.
constexpr float kDepthM = 0.8F;
/// tan of 15 degrees: steeper downward rays.
constexpr float kSteepness = 0.268F;
/// Every so many points for the median.
constexpr std::size_t kStride = 16;

[[nodiscard]] float median_intensity(const maps::PointCloud& cloud) {
  std::vector<float> sample;
  for (std::size_t i = 0; i < cloud.intensities.size(); i += kStride) {
    if (std::isfinite(cloud.intensities[i])) sample.push_back(cloud.intensities[i]);
  }
  if (sample.empty()) return std::numeric_limits<float>::infinity();
  return maps::median(std::move(sample));
}

}  // namespace

std::vector<std::uint8_t> find_reflected_noise(const maps::PointCloud& cloud,
                                               const SeedPlane& plane) {
  std::vector<std::uint8_t> noise;
  const bool has_intensity = !cloud.intensities.empty();
  float weak = std::numeric_limits<float>::infinity();
  const Eigen::Vector2f slope = plane.slope.cast<float>();
  const auto limit = static_cast<float>(plane.height) - kDepthM;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.positions[i];
    if (!(p.z() < limit + slope.dot(p.head<2>()))) continue;
    const Eigen::Vector3f ray = cloud.ray(i);
    if (!(ray.z() < -kSteepness * ray.head<2>().norm())) continue;
    if (noise.empty()) {
      noise.assign(cloud.size(), 0);
      if (has_intensity) weak = median_intensity(cloud);
    }
    if (!has_intensity || cloud.intensities[i] < weak) noise[i] = 1;
  }
  return noise;
}

}  // namespace stillmap::mapping

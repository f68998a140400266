#include "reference/region_ground.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cstddef>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kSkippedLowest = 5;
constexpr std::size_t kLowest = 20;
constexpr double kSeedHeightM = 0.5;
constexpr int kIterations = 3;
constexpr double kGroundDistanceM = 0.15;

/// Mean height of the lowest points but for the very lowest; 0, the ground's height in the frame of
/// the vehicle, when there are no others.
double lowest_height(const std::vector<Eigen::Vector3f>& points) {
  std::vector<float> heights;
  heights.reserve(points.size());
  for (const Eigen::Vector3f& p : points) heights.push_back(p.z());
  const std::size_t end = std::min(points.size(), kSkippedLowest + kLowest);
  std::partial_sort(heights.begin(), heights.begin() + static_cast<std::ptrdiff_t>(end),
                    heights.end());
  if (end <= kSkippedLowest) return 0.0;
  double sum = 0.0;
  for (std::size_t i = kSkippedLowest; i < end; ++i) sum += static_cast<double>(heights[i]);
  return sum / static_cast<double>(end - kSkippedLowest);
}

struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double offset = 0.0;
};

/// Least squares plane through the points whose flag is set, at least one.
Plane fit_plane(const std::vector<Eigen::Vector3f>& points,
                const std::vector<std::uint8_t>& is_ground) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double count = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (is_ground[i] == 0) continue;
    mean += points[i].cast<double>();
    count += 1.0;
  }
  mean /= count;
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (is_ground[i] == 0) continue;
    const Eigen::Vector3d centred = points[i].cast<double>() - mean;
    scatter += centred * centred.transpose();
  }
  const maps::SymmetricEigen<3> eigen = maps::eigen_of(scatter);
  Plane plane;
  plane.normal = eigen.vectors.col(0);
  if (plane.normal.z() < 0.0) plane.normal = -plane.normal;
  plane.offset = -plane.normal.dot(mean);
  return plane;
}

}  // namespace

std::vector<std::uint8_t> region_ground(const std::vector<Eigen::Vector3f>& points) {
  std::vector<std::uint8_t> is_ground(points.size(), 0);
  if (points.size() < 3) return is_ground;
  const double seeds_below_m = lowest_height(points) + kSeedHeightM;
  for (std::size_t i = 0; i < points.size(); ++i) {
    is_ground[i] = static_cast<double>(points[i].z()) < seeds_below_m ? 1 : 0;
  }
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    if (std::find(is_ground.begin(), is_ground.end(), 1) == is_ground.end()) break;
    const Plane plane = fit_plane(points, is_ground);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double height = plane.normal.dot(points[i].cast<double>()) + plane.offset;
      is_ground[i] = height < kGroundDistanceM ? 1 : 0;
    }
  }
  return is_ground;
}

}  // namespace stillmap::mapping

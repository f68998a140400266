#include <stillmap/maps/ground_plane.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Geometry>

#include <cmath>
#include <cstdint>
#include <vector>

namespace stillmap::maps {
namespace {

constexpr std::size_t kMostPlanePoints = 3000;
constexpr int kDraws = 300;
constexpr double kNearM = 2.0;
constexpr double kFarM = 20.0;
constexpr double kThicknessM = 0.1;
/// Behind the plane by more than this: not on the ground.
constexpr double kBehindM = 0.3;
constexpr double kMostBehind = 0.05;
constexpr double kLeastShare = 0.12;
constexpr double kLeastShareAnywhere = 0.35;
constexpr double kNearLevelCos = 0.866;

using GroundPoints = std::vector<Eigen::Vector3d>;

GroundPoints near_ones(std::span<const Eigen::Vector3f> points) {
  GroundPoints near;
  for (const Eigen::Vector3f& p : points) {
    const double range_m = p.cast<double>().norm();
    if (range_m >= kNearM && range_m <= kFarM) near.push_back(p.cast<double>());
  }
  const std::size_t step = near.size() / kMostPlanePoints + 1;
  GroundPoints some;
  for (std::size_t i = 0; i < near.size(); i += step) some.push_back(near[i]);
  return some;
}

/// Numbers that look random and are the same every time (splitmix64).
class Draws {
 public:
  std::size_t below(std::size_t end) {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15U);
    z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
    return static_cast<std::size_t>((z ^ (z >> 31U)) % end);
  }

 private:
  std::uint64_t state_ = 0;
};

double distance(const GroundPlane& plane, const Eigen::Vector3d& p) {
  return plane.up.dot(p) + plane.height_m;
}

/// Share of points on the plane; 0 when too many are behind it.
double share_on(const GroundPlane& plane, const GroundPoints& points) {
  std::size_t on = 0, behind = 0;
  for (const Eigen::Vector3d& p : points) {
    const double d = distance(plane, p);
    on += std::abs(d) <= kThicknessM ? 1U : 0U;
    behind += d < -kBehindM ? 1U : 0U;
  }
  const auto all = static_cast<double>(points.size());
  return static_cast<double>(behind) <= kMostBehind * all ? static_cast<double>(on) / all : 0.0;
}

std::optional<GroundPlane> through(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                   const Eigen::Vector3d& c) {
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double length = normal.norm();
  if (!(length > 0.1)) return std::nullopt;
  GroundPlane plane{normal / length, -normal.dot(a) / length};
  // The sensor is on the upper side.
  if (plane.height_m < 0.0) plane = {-plane.up, -plane.height_m};
  return plane;
}

/// Least squares over the points on it.
GroundPlane refined(const GroundPlane& plane, const GroundPoints& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
  double count = 0.0;
  for (const Eigen::Vector3d& p : points) {
    if (std::abs(distance(plane, p)) > kThicknessM) continue;
    mean += p;
    moments += p * p.transpose();
    count += 1.0;
  }
  mean /= count;
  const Eigen::Matrix3d covariance = moments / count - mean * mean.transpose();
  const SymmetricEigen<3> eigen = eigen_of(covariance);
  Eigen::Vector3d up = eigen.vectors.col(0);
  if (up.dot(plane.up) < 0.0) up = -up;
  return {up, -up.dot(mean)};
}

}  // namespace

std::optional<GroundPlane> find_ground_plane(std::span<const Eigen::Vector3f> points) {
  const GroundPoints near = near_ones(points);
  if (near.size() < 100) return std::nullopt;
  Draws draws;
  double best_level = kLeastShare, best_anywhere = kLeastShareAnywhere;
  std::optional<GroundPlane> level, anywhere;
  for (int i = 0; i < kDraws; ++i) {
    const auto plane = through(near[draws.below(near.size())], near[draws.below(near.size())],
                               near[draws.below(near.size())]);
    if (!plane) continue;
    const double share = share_on(*plane, near);
    const bool is_level = std::abs(plane->up.z()) >= kNearLevelCos;
    double& best = is_level ? best_level : best_anywhere;
    if (share <= best) continue;
    best = share;
    (is_level ? level : anywhere) = plane;
  }
  const std::optional<GroundPlane>& found = level ? level : anywhere;
  if (!found) return std::nullopt;
  return refined(refined(*found, near), near);
}

}  // namespace stillmap::maps

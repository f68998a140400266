#include "odometry/loam/surfaces.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Geometry>

#include <cmath>

namespace stillmap::mapping::loam {
namespace {

/// Points nearer to each other span nothing [m].
constexpr double kMinSpanM = 0.05;
/// Sine of the angle below which three points are a line.
constexpr double kMinSine = 0.05;
/// A line's largest eigenvalue beats the next by this, as in the authors' code.
constexpr double kLineRatio = 3.0;
/// A plane's middle eigenvalue beats the smallest by this, and is this share of the largest: five
/// points of one ring are a line, and any plane goes through it.
constexpr double kPlaneRatio = 25.0;
constexpr double kMinPlaneWidth = 0.02;
/// No neighbour may lie farther off the plane [m]; twice that in the authors' code.
constexpr double kMaxOffPlaneM = 0.1;

/// An edge is only known to the next beam, some centimetres away, a plane to the noise of the
/// range. The paper weighs both alike.
constexpr double kLineWeight = 0.25;

Surface line(const Eigen::Vector3d& point, const Eigen::Vector3d& direction) {
  const Eigen::Vector3d n = direction.unitOrthogonal();
  return {point, {n, direction.cross(n)}, 2, kLineWeight};
}

struct Spread {
  Eigen::Vector3d mean;
  maps::SymmetricEigen<3> eigen;
};

Spread spread_of(std::span<const Eigen::Vector3f> neighbours) {
  Spread spread;
  spread.mean.setZero();
  const auto n = static_cast<double>(neighbours.size());
  for (const Eigen::Vector3f& p : neighbours) spread.mean += p.cast<double>() / n;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3f& p : neighbours) {
    const Eigen::Vector3d d = p.cast<double>() - spread.mean;
    covariance += d * d.transpose() / n;
  }
  spread.eigen = maps::eigen_directly_of(covariance);
  return spread;
}

}  // namespace

double Surface::distance(const Eigen::Vector3d& X) const {
  const double first = normals[0].dot(X - point);
  const double second = normals[1].dot(X - point);
  return rows == 1 ? std::abs(first) : std::sqrt(first * first + second * second);
}

std::optional<Surface> line_through(const Eigen::Vector3d& j, const Eigen::Vector3d& l) {
  const double span = (j - l).norm();
  if (!(span > kMinSpanM)) return std::nullopt;
  return line(j, (j - l) / span);
}

std::optional<Surface> plane_through(const Eigen::Vector3d& j, const Eigen::Vector3d& l,
                                     const Eigen::Vector3d& m) {
  const Eigen::Vector3d a = j - l;
  const Eigen::Vector3d b = j - m;
  const Eigen::Vector3d n = a.cross(b);
  const double area = n.norm();
  if (!(a.norm() > kMinSpanM && b.norm() > kMinSpanM)) return std::nullopt;
  if (!(area > kMinSine * a.norm() * b.norm())) return std::nullopt;
  return Surface{j, {n / area, Eigen::Vector3d::Zero()}, 1, 1.0};
}

std::optional<Surface> line_of(std::span<const Eigen::Vector3f> neighbours,
                               const Eigen::Vector3d& centre) {
  const Spread spread = spread_of(neighbours);
  const Eigen::Vector3d& values = spread.eigen.values;
  if (!(values[2] > kMinSpanM * kMinSpanM && values[2] > kLineRatio * values[1])) {
    return std::nullopt;
  }
  return line(centre + spread.mean, spread.eigen.vectors.col(2));
}

std::optional<Surface> plane_of(std::span<const Eigen::Vector3f> neighbours,
                                const Eigen::Vector3d& centre) {
  const Spread spread = spread_of(neighbours);
  const Eigen::Vector3d& values = spread.eigen.values;
  if (!(values[1] > kPlaneRatio * values[0] && values[1] > kMinPlaneWidth * values[2])) {
    return std::nullopt;
  }
  const Eigen::Vector3d n = spread.eigen.vectors.col(0);
  for (const Eigen::Vector3f& p : neighbours) {
    if (!(std::abs(n.dot(p.cast<double>() - spread.mean)) < kMaxOffPlaneM)) return std::nullopt;
  }
  return Surface{centre + spread.mean, {n, Eigen::Vector3d::Zero()}, 1, 1.0};
}

}  // namespace stillmap::mapping::loam

#pragma once

#include <Eigen/Core>

#include <algorithm>

namespace stillmap::mapping {

/// A plane through points by principal components.
/// @see Patchwork, RA-L 2021, region-wise ground plane fitting.
struct PlaneFit {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  /// Unit normal, upward.
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  /// Variances along the three principal directions [m^2], the largest first.
  Eigen::Vector3d variances = Eigen::Vector3d::Zero();
  /// Variance across the plane [m^2]; small is flat.
  double flatness = 0.0;
  int points = 0;

  /// Uprightness, cos of the angle to the vertical.
  [[nodiscard]] double uprightness() const { return normal.z(); }
  /// 1 for a disc, large for points along a line.
  [[nodiscard]] double line_ratio() const { return variances[0] / std::max(variances[1], 1e-12); }
  [[nodiscard]] double height_at(double x, double y) const {
    return mean.z() - (normal.x() * (x - mean.x()) + normal.y() * (y - mean.y())) / normal.z();
  }
};

/// Sums over points for a plane.
class PlaneSums {
 public:
  void add(double x, double y, double z) {
    ++points_;
    sum_ += Eigen::Vector3d(x, y, z);
    xx_ += x * x;
    xy_ += x * y;
    xz_ += x * z;
    yy_ += y * y;
    yz_ += y * z;
    zz_ += z * z;
  }
  [[nodiscard]] int points() const { return points_; }
  /// Needs at least 3 points. Where they lie along a line, which leaves the tilt across it open (a
  /// single ring of a sparse sensor), the plane is turned about that line to be as level as it can.
  [[nodiscard]] PlaneFit fit() const;

 private:
  int points_ = 0;
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  double xx_ = 0.0, xy_ = 0.0, xz_ = 0.0, yy_ = 0.0, yz_ = 0.0, zz_ = 0.0;
};

}  // namespace stillmap::mapping

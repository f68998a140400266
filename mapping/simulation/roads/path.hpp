#pragma once

#include <Eigen/Core>

#include <memory>
#include <vector>

namespace stillmap::simulation {

/// Value of a uniform cubic B-spline with these control values, at `u` in units of their spacing
/// (clamped). Twice differentiable.
[[nodiscard]] double spline_value(const std::vector<double>& controls, double u);

/// Smooth line on the ground that something drives or walks along.
class Path {
 public:
  /// @param points  any spacing; at least two different ones.
  explicit Path(const std::vector<Eigen::Vector2d>& points);

  /// Length by which places on it are given [m]: exact on straights, a few centimetres longer than
  /// the line in tight turns, whose corners the spline cuts.
  [[nodiscard]] double length_m() const { return static_cast<double>(x_.size() - 1); }
  /// Point `offset_m` to the left of the line.
  [[nodiscard]] Eigen::Vector2d point(double station_m, double offset_m = 0.0) const;
  [[nodiscard]] double heading_rad(double station_m) const;
  /// 1 / radius, positive to the left [1/m].
  [[nodiscard]] double curvature(double station_m) const;

 private:
  /// Control points every metre.
  std::vector<double> x_;
  std::vector<double> y_;
};

/// How something moves along a path.
struct Motion {
  std::shared_ptr<const Path> path;
  /// Time of the first sample [s], and station and offset every `kStep_s`.
  double begin_s = 0.0;
  std::vector<double> stations_m;
  std::vector<double> offsets_m;

  static constexpr double kStep_s = 0.1;

  [[nodiscard]] double end_s() const {
    return begin_s + kStep_s * static_cast<double>(stations_m.size() - 1);
  }
  [[nodiscard]] bool covers(double time_s) const { return time_s >= begin_s && time_s <= end_s(); }
  [[nodiscard]] double station(double time_s) const;
  [[nodiscard]] Eigen::Vector2d point(double time_s) const;
  /// Of the velocity where it moves, of the path where it stands.
  [[nodiscard]] double heading_rad(double time_s) const;
  [[nodiscard]] double speed_mps(double time_s) const;
};

}  // namespace stillmap::simulation

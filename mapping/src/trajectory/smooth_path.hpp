#pragma once

#include <Eigen/Geometry>

#include <cstddef>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// A path whose poses are means over a box in time: noise of single poses shrinks, and poses
/// between two given ones are as noisy as those at one. Two paths of one rigid body that are
/// smoothed alike move alike. Between poses it is straight.
class SmoothPath {
 public:
  struct Pose {
    /// By any clock [s].
    double t_s = 0.0;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    /// Whether the way from the pose before is known.
    bool follows = true;
  };

  /// @param poses  in increasing time, at least two. @param box_s  > 0.
  SmoothPath(const std::vector<Pose>& poses, double box_s);

  [[nodiscard]] double begin_s() const { return t_s_.front(); }
  [[nodiscard]] double end_s() const { return t_s_.back(); }
  /// Nothing where the box reaches beyond the path or over a way that is not known.
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(double t_s) const;
  /// Motion from one time to a later one. @param throughout  the whole way is known, not only both
  /// boxes.
  [[nodiscard]] std::optional<Eigen::Isometry3d> motion(double from_s, double to_s,
                                                        bool throughout = false) const;

 private:
  /// Position from the first one, and quaternion x y z w of steady sign.
  using Values = Eigen::Matrix<double, 7, 1>;
  [[nodiscard]] std::size_t segment_at(double t_s) const;
  [[nodiscard]] Values integral_to(double t_s, std::size_t segment) const;
  [[nodiscard]] bool is_known(double from_s, double to_s) const;

  double box_s_;
  std::vector<double> t_s_;
  std::vector<Values> values_;
  /// From the first pose to each.
  std::vector<Values> integrals_;
  std::vector<std::size_t> unknown_;
};

}  // namespace stillmap::mapping

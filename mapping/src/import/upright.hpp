#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Names of the axes that may point up.
[[nodiscard]] bool is_axis(std::string_view up);

/// A rotation that takes the named axis to z and keeps the order of the others, where that axis is
/// positive: x left, y up, z ahead (LOAM's camera axes) become x ahead, y left, z up.
/// @param up  "x", "-x", "y", "-y", "z" or "-z".
[[nodiscard]] Eigen::Matrix3d R_upright(std::string_view up);

/// Looks whether a map stands on its side: maps of the ground are flat, so that z is the shortest
/// of their three extents.
class UprightCheck {
 public:
  void add(const Eigen::Vector3d& position);
  /// @return the axis that should be up, and by which extents; empty where z is as good.
  [[nodiscard]] std::string finding() const;

 private:
  /// Every `step_`th point, at most 65,536 of them.
  std::vector<Eigen::Vector3d> sample_;
  std::size_t step_ = 1;
  std::size_t seen_ = 0;
};

}  // namespace stillmap::mapping

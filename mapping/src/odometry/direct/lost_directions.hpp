#pragma once

#include <stillmap/localization/local_map.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <deque>
#include <vector>

namespace stillmap::mapping {

/// Directions that scans have stopped to tell, and how fast the sensor moved while they told all.
class LostDirections {
 public:
  using Twist = Eigen::Matrix<double, 6, 1>;

  /// The speed is told before any scan is.
  void start_with(const Twist& twist_lidar);
  /// Whether any is lost.
  [[nodiscard]] bool has_any() const { return !lost_.empty(); }
  /// Directions that are kept as predicted. By chance one scan of a tunnel in thirty seems to tell
  /// where along it one is, so they stay lost for a while. Before any speed is known, and nothing
  /// else tells, a match, be it weak, is better than to stand still.
  /// @param is_expected  whether the motion is told from elsewhere.
  [[nodiscard]] std::vector<Twist> untold(const localization::LocalAlignment& match,
                                          bool is_expected);
  /// A twist of scans that told all.
  void learn(const Twist& twist_lidar);
  /// A twist whose parts along the lost directions are the median of those.
  [[nodiscard]] Twist steadied(const Twist& twist_lidar) const;

 private:
  /// Rotations counted in metres at `kLeverM`.
  std::vector<Twist> lost_;
  /// Of the last scans that told all.
  std::deque<Twist> steady_;
  /// Scans since that told them again.
  std::size_t told_again_ = 0;
};

}  // namespace stillmap::mapping

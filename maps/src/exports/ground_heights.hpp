#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stillmap::maps {

/// Mean height of a map's ground in squares of 1 m, carried on for up to 5 m where none was seen.
class GroundHeights {
 public:
  /// @param min,max  what it covers [m].
  GroundHeights(const Eigen::Vector2d& min, const Eigen::Vector2d& max);

  /// Points outside are left out.
  void add(const Eigen::Vector3d& ground_point);
  /// Ends the adding. @return whether there was any ground.
  bool finish();

  /// [m]; NaN where no ground is near, and outside.
  [[nodiscard]] float at(double x, double y) const;

 private:
  /// Number of a square; that of none is beyond the last.
  [[nodiscard]] std::size_t square_at(double x, double y) const;
  void grow();

  Eigen::Vector2d min_;
  std::size_t width_, height_;
  std::vector<float> heights_m_;
  /// Points per square, until `finish`.
  std::vector<std::uint32_t> counts_;
};

}  // namespace stillmap::maps

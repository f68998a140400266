#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>

namespace stillmap::mapping {

/// How high the ground of a map is, by cells of 1 m; from its ground points alone.
class GroundLevels {
 public:
  /// Ground this far away still tells the height of a point [m].
  static constexpr double kReachM = 4.0;

  /// @param positions  N points [m]. @param is_ground  N flags.
  GroundLevels(std::span<const Eigen::Vector3f> positions, std::span<const std::uint8_t> is_ground);

  /// Height of the nearest cell with ground, less than kReachM away; nothing without one.
  [[nodiscard]] std::optional<float> below(const Eigen::Vector3f& p) const;

 private:
  struct Cell {
    double sum = 0.0;
    std::uint32_t count = 0;
  };
  std::unordered_map<std::uint64_t, Cell> cells_;
};

}  // namespace stillmap::mapping

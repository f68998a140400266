#pragma once

#include <stillmap/mapping/projection.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Finds the first of the movable boxes that a point lies in, grown as the options say.
///
/// Boxes are listed by columns of 4 m over x, y, so that the many points without a box cost one
/// look-up.
class BoxColumns {
 public:
  /// @param boxes  all finite. Boxes of a class that is not movable hold no point.
  BoxColumns(std::span<const MovableBox> boxes, const ProjectionOptions& options);

  /// @return index of the first box, -1 when there is none.
  [[nodiscard]] int first_with(const Eigen::Vector3f& p) const {
    const int column = column_of(p.x(), p.y());
    if (column < 0) return -1;
    const auto first = begin_[static_cast<std::size_t>(column)];
    const auto last = begin_[static_cast<std::size_t>(column) + 1];
    for (auto k = first; k < last; ++k) {
      const Grown& box = grown_[static_cast<std::size_t>(boxes_[k])];
      if (box.contains(p)) return box.index;
    }
    return -1;
  }

 private:
  struct Grown {
    Eigen::Vector3f centre;
    float half_along, half_across;
    /// Bounds of z less the centre's.
    float lowest, highest;
    float cosine, sine;
    int index;

    [[nodiscard]] bool contains(const Eigen::Vector3f& p) const {
      const Eigen::Vector3f d = p - centre;
      return std::abs(cosine * d.x() + sine * d.y()) <= half_along &&
             std::abs(cosine * d.y() - sine * d.x()) <= half_across && d.z() >= lowest &&
             d.z() <= highest;
    }
    [[nodiscard]] std::array<float, 2> reach() const {
      return {std::abs(cosine) * half_along + std::abs(sine) * half_across,
              std::abs(sine) * half_along + std::abs(cosine) * half_across};
    }
  };

  /// Clamped, so that a box kilometres away costs speed and not memory.
  [[nodiscard]] int index_of(std::size_t axis, float value) const {
    return static_cast<int>(std::clamp((value - min_[axis]) / kColumnM, 0.0F, kLastColumn));
  }
  [[nodiscard]] int column_of(float x, float y) const {
    const bool inside = x >= min_[0] && x <= max_[0] && y >= min_[1] && y <= max_[1];
    return inside ? index_of(1, y) * counts_[0] + index_of(0, x) : -1;
  }
  void list_by_column();
  template <typename Use>
  void for_each_listing(const Use& use) const;

  static constexpr float kColumnM = 4.0F;
  static constexpr float kLastColumn = 255.0F;
  std::vector<Grown> grown_;
  /// Of all boxes; empty without any.
  std::array<float, 2> min_ = {1.0F, 1.0F};
  std::array<float, 2> max_ = {-1.0F, -1.0F};
  std::array<int, 2> counts_{};
  /// First entry of each column in `boxes_`, and the end.
  std::vector<std::uint32_t> begin_ = {0};
  std::vector<std::uint32_t> boxes_;
};

}  // namespace stillmap::mapping

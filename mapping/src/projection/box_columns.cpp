#include "projection/box_columns.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace stillmap::mapping {
namespace {

/// A box may end this much above the ground and still reach down to it [m]: detectors that
/// leave out the wheels.
constexpr double kMarginDownM = 0.6;

}  // namespace

BoxColumns::BoxColumns(std::span<const MovableBox> boxes, const ProjectionOptions& options) {
  const bool plain = options.ground_height == GroundHeight::kMean;
  const double side = plain ? 0.0 : options.margin_m;
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const maps::Box& box = boxes[b].box;
    const auto& movable = options.classes;
    if (!movable.empty() &&
        std::find(movable.begin(), movable.end(), box.object_class) == movable.end())
      continue;
    const double smear = plain ? 0.0 : std::abs(boxes[b].speed_mps) * options.half_sweep_s;
    const double half_height = 0.5 * box.size_m.z();
    grown_.push_back(
        {.centre = box.centre.cast<float>(),
         .half_along = static_cast<float>(0.5 * box.size_m.x() + side + smear),
         .half_across = static_cast<float>(0.5 * box.size_m.y() + side),
         .lowest = static_cast<float>(-half_height - (plain ? 0.0 : kMarginDownM)),
         .highest = static_cast<float>(half_height + (plain ? 0.0 : options.margin_up_m)),
         .cosine = static_cast<float>(std::cos(box.yaw_rad)),
         .sine = static_cast<float>(std::sin(box.yaw_rad)),
         .index = static_cast<int>(b)});
  }
  list_by_column();
}

void BoxColumns::list_by_column() {
  if (grown_.empty()) return;
  min_.fill(std::numeric_limits<float>::max());
  max_.fill(std::numeric_limits<float>::lowest());
  for (const Grown& box : grown_) {
    const auto reach = box.reach();
    for (std::size_t axis = 0; axis < 2; ++axis) {
      const float centre = box.centre[static_cast<Eigen::Index>(axis)];
      min_[axis] = std::min(min_[axis], centre - reach[axis]);
      max_[axis] = std::max(max_[axis], centre + reach[axis]);
    }
  }
  for (std::size_t axis = 0; axis < 2; ++axis) counts_[axis] = index_of(axis, max_[axis]) + 1;
  begin_.assign(static_cast<std::size_t>(counts_[0] * counts_[1]) + 1, 0);
  for_each_listing([&](std::size_t column, std::uint32_t) { ++begin_[column + 1]; });
  std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
  boxes_.resize(begin_.back());
  std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
  for_each_listing([&](std::size_t column, std::uint32_t box) { boxes_[next[column]++] = box; });
}

template <typename Use>
void BoxColumns::for_each_listing(const Use& use) const {
  for (std::size_t k = 0; k < grown_.size(); ++k) {
    const auto reach = grown_[k].reach();
    const Eigen::Vector3f& c = grown_[k].centre;
    for (int iy = index_of(1, c.y() - reach[1]); iy <= index_of(1, c.y() + reach[1]); ++iy) {
      for (int ix = index_of(0, c.x() - reach[0]); ix <= index_of(0, c.x() + reach[0]); ++ix)
        use(static_cast<std::size_t>(iy * counts_[0] + ix), static_cast<std::uint32_t>(k));
    }
  }
}

}  // namespace stillmap::mapping

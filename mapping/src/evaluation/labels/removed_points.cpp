#include "evaluation/labels/removed_points.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Edge of a cell [m]: the largest distance and a little for rounding, so that neighbours of a cell
/// are enough.
constexpr float kRemovedCellM = 1.02F * RemovedPoints::kNearM;
/// Cells to a block of the coarse look.
constexpr int kBlockShift = 2;
constexpr std::size_t kReachBits = std::size_t{1} << 25U;

std::int32_t cell_along(float x) {
  return static_cast<std::int32_t>(std::floor(x / kRemovedCellM));
}

std::uint64_t removed_key(const std::array<std::int32_t, 3>& cell) {
  return maps::signed_cell_key(cell[0], cell[1], cell[2]);
}

std::size_t reach_bit(const std::array<std::int32_t, 3>& block) {
  return maps::hash_of_cell(removed_key(block)) >>
         (64U - static_cast<unsigned>(std::countr_zero(kReachBits)));
}

}  // namespace

void RemovedPoints::mark_near(const Cell& cell) {
  // Every block with a cell beside this one.
  for (int corner = 0; corner < 8; ++corner) {
    Cell block = cell;
    for (std::size_t axis = 0; axis < 3; ++axis)
      block[axis] = (cell[axis] + ((corner >> axis & 1) != 0 ? 1 : -1)) >> kBlockShift;
    const std::size_t bit = reach_bit(block);
    reach_[bit / 64] |= std::uint64_t{1} << (bit % 64);
  }
}

bool RemovedPoints::may_be_near(const Cell& cell) const {
  const std::size_t bit =
      reach_bit({cell[0] >> kBlockShift, cell[1] >> kBlockShift, cell[2] >> kBlockShift});
  return (reach_[bit / 64] >> (bit % 64) & 1U) != 0;
}

void RemovedPoints::sort() {
  const auto key_at = [](const Point& point) {
    return removed_key({cell_along(point.position.x()), cell_along(point.position.y()),
                        cell_along(point.position.z())});
  };
  {
    // Keys are sorted instead of points: comparisons would compute them again and again.
    std::vector<std::pair<std::uint64_t, std::uint32_t>> order(points_.size());
    for (std::size_t i = 0; i < order.size(); ++i)
      order[i] = {key_at(points_[i]), static_cast<std::uint32_t>(i)};
    std::sort(order.begin(), order.end());
    std::vector<Point> sorted(points_.size());
    for (std::size_t i = 0; i < order.size(); ++i) sorted[i] = points_[order[i].second];
    points_ = std::move(sorted);
  }
  cells_.clear();
  reach_.assign(kReachBits / 64, 0);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const auto at = static_cast<std::uint32_t>(i);
    const auto [range, is_new] = cells_.insert(key_at(points_[i]), {at, at});
    if (is_new) {
      const Eigen::Vector3f& p = points_[i].position;
      mark_near({cell_along(p.x()), cell_along(p.y()), cell_along(p.z())});
    }
    ++range->end;
  }
}

void RemovedPoints::meet_in(Range& range, const Eigen::Vector3f& position, std::uint16_t same,
                            std::uint16_t near) {
  for (std::uint32_t i = range.begin; i < range.end;) {
    Point& point = points_[i];
    // As DynamicMap_Benchmark and as the thinned map: at most the distance, in double.
    const double squared = (point.position.cast<double>() - position.cast<double>()).squaredNorm();
    constexpr double kSame2 = 0.05 * 0.05;
    constexpr double kNear2 = 0.1 * 0.1;
    if (squared <= kNear2) point.met |= near;
    if (squared <= kSame2) point.met |= same;
    if (point.met != kAll) {
      ++i;
      continue;
    }
    --range.end;
    std::swap(point, points_[range.end]);
  }
}

void RemovedPoints::meet(const Eigen::Vector3f& position, bool measured) {
  if (points_.empty()) return;
  const Cell own{cell_along(position.x()), cell_along(position.y()), cell_along(position.z())};
  if (!may_be_near(own)) return;
  const auto same = static_cast<std::uint16_t>(measured ? kAnySame | kMeasuredSame : kAnySame);
  const auto near = static_cast<std::uint16_t>(measured ? kAnyNear | kMeasuredNear : kAnyNear);
  for (std::int32_t x = own[0] - 1; x <= own[0] + 1; ++x) {
    for (std::int32_t y = own[1] - 1; y <= own[1] + 1; ++y) {
      for (std::int32_t z = own[2] - 1; z <= own[2] + 1; ++z) {
        if (Range* range = cells_.find(removed_key({x, y, z})))
          meet_in(*range, position, same, near);
      }
    }
  }
}

}  // namespace stillmap::mapping

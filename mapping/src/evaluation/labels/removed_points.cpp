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
  std::uint64_t key = 0;
  for (const std::int32_t axis : cell)
    key = (key << 21U) | (static_cast<std::uint64_t>(axis) & 0x1FFFFFU);
  return key;
}

/// Fibonacci hashing: the high bits of the product depend on all bits of the key.
std::uint64_t mixed(std::uint64_t key) { return key * 0x9E3779B97F4A7C15ULL; }

std::size_t reach_bit(const std::array<std::int32_t, 3>& block) {
  return mixed(removed_key(block)) >> (64U - static_cast<unsigned>(std::countr_zero(kReachBits)));
}

}  // namespace

RemovedPoints::Slot& RemovedPoints::slot_of(std::uint64_t key) {
  const std::size_t mask = slots_.size() - 1;
  std::size_t at = mixed(key) >> (64U - static_cast<unsigned>(std::countr_zero(slots_.size())));
  while (slots_[at].key != key && slots_[at].key != kFree) at = (at + 1) & mask;
  return slots_[at];
}

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
  std::size_t cells = 0;
  for (std::size_t i = 0; i < points_.size(); ++i)
    cells += i == 0 || key_at(points_[i]) != key_at(points_[i - 1]) ? 1 : 0;
  slots_.assign(std::bit_ceil(2 * cells + 2), {});
  reach_.assign(kReachBits / 64, 0);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const std::uint64_t key = key_at(points_[i]);
    Slot& slot = slot_of(key);
    if (slot.key == kFree) {
      slot = {key, static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(i)};
      const Eigen::Vector3f& p = points_[i].position;
      mark_near({cell_along(p.x()), cell_along(p.y()), cell_along(p.z())});
    }
    ++slot.end;
  }
}

void RemovedPoints::meet_in(Slot& slot, const Eigen::Vector3f& position, std::uint16_t same,
                            std::uint16_t near) {
  for (std::uint32_t i = slot.begin; i < slot.end;) {
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
    --slot.end;
    std::swap(point, points_[slot.end]);
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
        Slot& slot = slot_of(removed_key({x, y, z}));
        if (slot.key != kFree) meet_in(slot, position, same, near);
      }
    }
  }
}

}  // namespace stillmap::mapping

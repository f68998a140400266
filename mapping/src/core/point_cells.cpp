#include "point_cells.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr std::int64_t kHalfCells = maps::kCellsPerAxis / 2;

std::uint64_t key_of(const std::array<std::int64_t, 3>& cell) {
  return maps::signed_cell_key(cell[0], cell[1], cell[2]);
}

bool in_range(const std::array<std::int64_t, 3>& cell) {
  return std::all_of(cell.begin(), cell.end(),
                     [](std::int64_t axis) { return axis >= -kHalfCells && axis < kHalfCells; });
}

/// Distance along one axis from x [m] to cell number `cell`, 0 inside.
double gap(double x, std::int64_t cell, double cell_m) {
  const double low = static_cast<double>(cell) * cell_m;
  return std::max({low - x, x - (low + cell_m), 0.0});
}

}  // namespace

PointCells::PointCells(std::vector<Eigen::Vector3f> points, double cell_m)
    : cell_m_(cell_m), inverse_cell_(1.0 / cell_m) {
  if (!(cell_m > 0.0)) {
    throw std::invalid_argument("cell_m: " + std::to_string(cell_m) + ", must be > 0");
  }
  if (points.size() >= std::numeric_limits<std::uint32_t>::max()) {
    throw std::invalid_argument("points: " + std::to_string(points.size()) + ", too many");
  }
  const double reach_m = cell_m * static_cast<double>(kHalfCells - 1);
  for (const Eigen::Vector3f& p : points) {
    if (!(p.cwiseAbs().maxCoeff() < reach_m) || !p.allFinite()) {
      throw std::invalid_argument("points: a coordinate is not finite or beyond " +
                                  std::to_string(reach_m) + " m");
    }
  }
  sort_points(std::move(points));
  fill_table();
}

PointCells::Cell PointCells::cell_of(const Eigen::Vector3f& p) const {
  const auto axis = [this](float x) {
    return static_cast<std::int64_t>(std::floor(static_cast<double>(x) * inverse_cell_));
  };
  return {axis(p.x()), axis(p.y()), axis(p.z())};
}

void PointCells::sort_points(std::vector<Eigen::Vector3f> points) {
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keyed(points.size());
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    keyed[i] = {key_of(cell_of(points[i])), static_cast<std::uint32_t>(i)};
  });
  tbb::parallel_sort(keyed);
  points_.resize(points.size());
  given_index_.resize(points.size());
  for (std::size_t i = 0; i < keyed.size(); ++i) {
    points_[i] = points[keyed[i].second];
    given_index_[i] = keyed[i].second;
    if (i == 0 || keyed[i].first != keyed[i - 1].first) {
      begins_.push_back(static_cast<std::uint32_t>(i));
    }
  }
  begins_.push_back(static_cast<std::uint32_t>(points_.size()));
}

void PointCells::fill_table() {
  const std::size_t slots = std::bit_ceil(std::max<std::size_t>(2, cells() + cells() / 2));
  table_.assign(slots, 0);
  table_shift_ = 64U - static_cast<unsigned>(std::countr_zero(slots));
  for (std::size_t cell = 0; cell < cells(); ++cell) {
    std::size_t slot = slot_of(key_of(cell_of(points_[begins_[cell]])));
    while (table_[slot] != 0) slot = (slot + 1) & (slots - 1);
    table_[slot] = static_cast<std::uint32_t>(cell) + 1;
  }
}

std::size_t PointCells::slot_of(std::uint64_t key) const {
  return static_cast<std::size_t>(maps::hash_of_cell(key) >> table_shift_);
}

PointCells::Range PointCells::find(const Cell& cell) const {
  if (!in_range(cell)) return {};
  std::size_t slot = slot_of(key_of(cell));
  for (; table_[slot] != 0; slot = (slot + 1) & (table_.size() - 1)) {
    const Range range = this->cell(table_[slot] - 1);
    if (cell_of(points_[range.begin]) == cell) return range;
  }
  return {};
}

std::array<PointCells::Range, 27> PointCells::around(std::size_t cell) const {
  const Cell middle = cell_of(points_[begins_[cell]]);
  std::array<Range, 27> ranges;
  std::size_t next = 0;
  for (std::int64_t x = -1; x <= 1; ++x) {
    for (std::int64_t y = -1; y <= 1; ++y) {
      for (std::int64_t z = -1; z <= 1; ++z)
        ranges[next++] = find({middle[0] + x, middle[1] + y, middle[2] + z});
    }
  }
  return ranges;
}

void PointCells::search_cell(const Cell& cell, const Eigen::Vector3d& p, bool any,
                             std::optional<Neighbour>& best, double& limit_m2) const {
  const Range range = find(cell);
  for (std::uint32_t i = range.begin; i < range.end; ++i) {
    const double squared = (points_[i].cast<double>() - p).squaredNorm();
    const std::uint32_t given = given_index_[i];
    if (squared > limit_m2 || (best && squared == limit_m2 && given > best->point)) continue;
    best = Neighbour{given, squared};
    limit_m2 = squared;
    if (any) return;
  }
}

std::optional<PointCells::Neighbour> PointCells::search(const Eigen::Vector3f& p, double radius_m,
                                                        bool any) const {
  std::optional<Neighbour> best;
  const Eigen::Vector3d exact = p.cast<double>();
  // Written so that a NaN fails; what is further out than any cell finds nothing.
  if (!(exact.cwiseAbs().maxCoeff() < cell_m_ * static_cast<double>(kHalfCells) + radius_m) ||
      !exact.allFinite()) {
    return best;
  }
  double limit_m2 = radius_m * radius_m;
  const Cell own = cell_of(p);
  search_cell(own, exact, any, best, limit_m2);
  if (any && best) return best;
  const Eigen::Array3d low = ((exact.array() - radius_m) * inverse_cell_).floor();
  const Eigen::Array3d high = ((exact.array() + radius_m) * inverse_cell_).floor();
  Cell cell{};
  for (cell[0] = std::int64_t(low[0]); cell[0] <= std::int64_t(high[0]); ++cell[0]) {
    const double gap_x = gap(exact.x(), cell[0], cell_m_);
    for (cell[1] = std::int64_t(low[1]); cell[1] <= std::int64_t(high[1]); ++cell[1]) {
      const double gap_y = gap(exact.y(), cell[1], cell_m_);
      const double gap_xy2 = gap_x * gap_x + gap_y * gap_y;
      if (gap_xy2 > limit_m2) continue;
      for (cell[2] = std::int64_t(low[2]); cell[2] <= std::int64_t(high[2]); ++cell[2]) {
        const double gap_z = gap(exact.z(), cell[2], cell_m_);
        if (cell == own || gap_xy2 + gap_z * gap_z > limit_m2) continue;
        search_cell(cell, exact, any, best, limit_m2);
        if (any && best) return best;
      }
    }
  }
  return best;
}

std::optional<PointCells::Neighbour> PointCells::nearest(const Eigen::Vector3f& p,
                                                         double radius_m) const {
  return search(p, radius_m, false);
}

bool PointCells::any_within(const Eigen::Vector3f& p, double radius_m) const {
  return search(p, radius_m, true).has_value();
}

}  // namespace stillmap::mapping

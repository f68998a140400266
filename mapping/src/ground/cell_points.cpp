#include "ground/cell_points.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace stillmap::mapping {
namespace {

constexpr int kGridSide = HeightGrid::kCellsPerSide;
constexpr auto kCellCount = static_cast<std::size_t>(kGridSide) * kGridSide;

PatchLayout make_layout() {
  PatchLayout layout;
  layout.patch_of_cell.resize(kCellCount);
  layout.range_m.resize(kCellCount);
  std::vector<int> slots_of_patch(ConcentricZones::kPatchCount + 1, 0);
  for (std::size_t cell = 0; cell < kCellCount; ++cell) {
    const double x = HeightGrid::centre_x(static_cast<int>(cell));
    const double y = HeightGrid::centre_y(static_cast<int>(cell));
    const int patch = ConcentricZones::patch_of(x, y);
    layout.patch_of_cell[cell] = patch;
    layout.range_m[cell] = static_cast<float>(std::hypot(x, y));
    ++slots_of_patch[static_cast<std::size_t>(patch < 0 ? ConcentricZones::kPatchCount : patch)];
  }
  layout.first_slot.assign(ConcentricZones::kPatchCount + 2, 0);
  std::partial_sum(slots_of_patch.begin(), slots_of_patch.end(), layout.first_slot.begin() + 1);
  std::vector<int> next = layout.first_slot;
  layout.slot_of_cell.resize(kCellCount);
  for (std::size_t cell = 0; cell < kCellCount; ++cell) {
    const int patch = layout.patch_of_cell[cell];
    const int group = patch < 0 ? ConcentricZones::kPatchCount : patch;
    layout.slot_of_cell[cell] = next[static_cast<std::size_t>(group)]++;
  }
  layout.near_to_far.resize(kCellCount);
  std::iota(layout.near_to_far.begin(), layout.near_to_far.end(), 0);
  const auto squared_range = [](int cell) {
    // Twice the centre's coordinates are integers, so equal ranges tie exactly.
    const int x = 2 * (cell % kGridSide) + 1 - kGridSide;
    const int y = 2 * (cell / kGridSide) + 1 - kGridSide;
    return x * x + y * y;
  };
  std::stable_sort(layout.near_to_far.begin(), layout.near_to_far.end(),
                   [&](int a, int b) { return squared_range(a) < squared_range(b); });
  return layout;
}

}  // namespace

const PatchLayout& PatchLayout::instance() {
  static const PatchLayout layout = make_layout();
  return layout;
}

CellPoints::CellPoints(const maps::PointCloud& cloud, const std::vector<std::uint8_t>& left_out)
    : layout_(&PatchLayout::instance()), first_(kCellCount + 1, 0) {
  std::vector<int> slot_of_point(cloud.size(), -1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.positions[i];
    const int cell = HeightGrid::index_of(p.x(), p.y());
    if (cell < 0 || !std::isfinite(p.z()) || (!left_out.empty() && left_out[i] != 0)) continue;
    const int slot = layout_->slot_of_cell[static_cast<std::size_t>(cell)];
    slot_of_point[i] = slot;
    ++first_[static_cast<std::size_t>(slot) + 1];
  }
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
  points_.resize(static_cast<std::size_t>(first_.back()));
  std::vector<int> next(first_.begin(), first_.end() - 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (slot_of_point[i] < 0) continue;
    const Eigen::Vector3f& p = cloud.positions[i];
    const int at = next[static_cast<std::size_t>(slot_of_point[i])]++;
    points_[static_cast<std::size_t>(at)] = {p.x(), p.y(), p.z(), static_cast<std::uint32_t>(i)};
  }
  for (const int cell : layout_->near_to_far) {
    if (!of_cell(cell).empty()) occupied_.push_back(cell);
  }
}

void CellPoints::level(const SeedPlane& plane) {
  const Eigen::Vector2f slope = plane.slope.cast<float>();
  const auto height = static_cast<float>(plane.height);
  for (CellPoint& p : points_) p.z -= height + slope.x() * p.x + slope.y() * p.y;
}

}  // namespace stillmap::mapping

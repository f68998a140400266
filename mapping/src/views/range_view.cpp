#include "views/range_view.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// A second surface in a bin is kept when it is this much farther [m]; less is the same surface, or
/// noise.
constexpr float kApartM = 0.3F;

/// Half-width of what a ray may miss by: pose and deskewing, in translation [m] and rotation [rad],
/// with the beam's own half-width (0.1 degree) in the latter.
constexpr float kGuardM = 0.03F;
constexpr float kGuardRad = 0.0035F;

/// How far apart one thing may lie in scans that are seconds apart: poses of GNSS and odometry
/// wander by this much within a street [m]. What a scan sees so near to a cell may be the very
/// thing that others saw in it.
constexpr float kWanderM = 0.3F;

/// A view says "free" only where it saw nothing within so many times the uncertainty of its pose.
constexpr float kDoubts = 3.0F;

/// Beyond it a view can say nothing of a place [m]; it also bounds what has to be looked at.
constexpr float kMostDoubtM = 2.0F;

/// A surface counts as beyond a cell from here on [m]; grows with range, since surfaces seen at a
/// grazing angle cover a longer way within a bin.
constexpr float kBeyondM = 0.3F;
constexpr float kBeyondPerM = 0.01F;

std::uint16_t quantized(float range_m, float quantum_m) {
  return static_cast<std::uint16_t>(std::clamp(range_m / quantum_m, 1.0F, 65534.0F));
}

/// Columns and rows that a cone touches; columns still unwrapped, rows within the view.
struct Window {
  int row_begin, row_end, column_begin, column_end;
};

/// A direction in units of bins.
struct Aim {
  float row, column;
  /// How many columns a row's height is wide: more towards the poles. Near one, a wide piece of
  /// the circle does as well as all of it, since what matters is at street level.
  float columns_per_row;

  Aim(const Eigen::Vector3f& p, float range_m) {
    constexpr float kHalfTurn = std::numbers::pi_v<float>;
    const float flat_m = std::sqrt(p.x() * p.x() + p.y() * p.y());
    row = (ViewGrid::angle(p.z(), flat_m) + 0.5F * kHalfTurn) * (1.0F / ViewGrid::kRowRad);
    // A turn more keeps it above zero, so that truncation rounds down.
    column = (ViewGrid::azimuth(p) + 3.0F * kHalfTurn) * (1.0F / ViewGrid::kColumnRad);
    columns_per_row = std::min(range_m, 20.0F * flat_m) / std::max(flat_m, 0.05F * range_m);
  }

  [[nodiscard]] Window cone(float radius_rad, int first_row, int end_row) const {
    const float rows = radius_rad * (1.0F / ViewGrid::kRowRad);
    const float columns = radius_rad * (1.0F / ViewGrid::kColumnRad) * columns_per_row;
    return {std::max(static_cast<int>(row - rows), first_row),
            std::min(static_cast<int>(row + rows) + 1, end_row), static_cast<int>(column - columns),
            static_cast<int>(column + columns) + 1};
  }
};

}  // namespace

RangeView::RangeView(std::span<const Eigen::Vector3f> positions,
                     std::span<const std::uint8_t> is_ground) {
  if (!is_ground.empty() && is_ground.size() != positions.size())
    throw std::invalid_argument("is_ground: expected one flag a point or none");
  std::vector<std::uint16_t> rows(positions.size());
  int lowest = ViewGrid::kRows, highest = -1;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const int row = ViewGrid::row_of(ViewGrid::elevation(positions[i]));
    rows[i] = static_cast<std::uint16_t>(row);
    lowest = std::min(lowest, row);
    highest = std::max(highest, row);
  }
  if (highest < lowest) return;
  first_row_ = lowest;
  bins_.resize(static_cast<std::size_t>(highest - lowest + 1) * ViewGrid::kColumns);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const int column = ViewGrid::wrapped(ViewGrid::column_of(ViewGrid::azimuth(positions[i])));
    Bin& bin = bins_[static_cast<std::size_t>((rows[i] - lowest) * ViewGrid::kColumns + column)];
    const std::uint16_t range = quantized(positions[i].norm(), kQuantumM);
    bin.farthest = std::max(bin.farthest, range);
    if (is_ground.empty() || is_ground[i] == 0) bin.nearest = std::min(bin.nearest, range);
  }
  const std::uint16_t apart = quantized(kApartM, kQuantumM);
  for (Bin& bin : bins_) {
    if (bin.nearest != kNone && bin.farthest < bin.nearest + apart) bin.farthest = bin.nearest;
  }
}

bool RangeView::any_near(const Eigen::Vector3f& p, float radius_m, float doubt_m) const {
  const float range_m = p.norm();
  const float wander_m = std::max(kWanderM, kDoubts * doubt_m);
  const float beyond_m = kBeyondM + kBeyondPerM * range_m;
  const Window around =
      Aim(p, range_m).cone((radius_m + wander_m) / range_m + kGuardRad, first_row_, end_row());
  const auto before = static_cast<int>((range_m - beyond_m - wander_m) / kQuantumM);
  const auto after = static_cast<int>((range_m + beyond_m + wander_m) / kQuantumM);
  for (int row = around.row_begin; row < around.row_end; ++row) {
    for (int column = around.column_begin; column < around.column_end; ++column) {
      const Bin& b = bin(row, column);
      if (b.nearest != kNone && b.nearest >= before && b.nearest <= after) return true;
    }
  }
  return false;
}

Look RangeView::look(const Eigen::Vector3f& p, float radius_m, float doubt_m) const {
  const float range_m = p.norm();
  if (!(range_m > radius_m)) return {};
  const float beyond_m = kBeyondM + kBeyondPerM * range_m;
  const auto after = static_cast<int>((range_m + beyond_m) / kQuantumM);
  const auto before = static_cast<int>((range_m - beyond_m) / kQuantumM);
  const Aim aim(p, range_m);
  bool any = false, passed = false;
  const Window inner = aim.cone(radius_m / range_m, first_row_, end_row());
  for (int row = inner.row_begin; row < inner.row_end; ++row) {
    for (int column = inner.column_begin; column < inner.column_end; ++column) {
      const Bin& b = bin(row, column);
      if (b.farthest == 0) continue;
      any = true;
      // Of ground the farthest return is known; before the cell it says nothing.
      const std::uint16_t met = b.nearest != kNone ? b.nearest : b.farthest;
      if (met >= before && met <= after) return {Sight::kHit};
      if (b.farthest > after) passed = true;
    }
  }
  if (!any) return {};
  if (!passed) return {Sight::kHidden};
  if (kDoubts * doubt_m > kMostDoubtM) return {};
  const Window outer = aim.cone((radius_m + std::max(kGuardM, doubt_m)) / range_m + kGuardRad,
                                first_row_, end_row());
  int rays = 0;
  for (int row = outer.row_begin; row < outer.row_end; ++row) {
    for (int column = outer.column_begin; column < outer.column_end; ++column) {
      const Bin& b = bin(row, column);
      if (b.nearest <= after) return {Sight::kMixed};
      if (b.farthest != 0) ++rays;
    }
  }
  // Says nothing either way: against the cell it would shield all that moves along a wall.
  if (any_near(p, radius_m, doubt_m)) return {};
  return {Sight::kFree, rays};
}

}  // namespace stillmap::mapping

#include "ground/point_labels.hpp"

#include "ground/cell_layer.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stillmap::mapping {
namespace {

/// Columns along a cell's side that are looked at apart.
constexpr int kColumns = 4;
/// How far a ground point may be off the surface [m], and by how much more per metre of range:
/// beside kerbs and on rough ground the surface is a mean.
constexpr float kOpenM = 0.15F;
constexpr float kOpenPerM = 0.0015F;
constexpr float kMaxOpenM = 0.25F;
/// The same above the surface where something stands: noise and little more.
constexpr float kBesideM = 0.04F;
constexpr float kBesidePerM = 0.001F;
/// Confidence of a filled cell that touches seen ground. Farther from it the surface is a guess,
/// and what stands there may cut it at any height.
constexpr float kTouching = 0.85F;

struct Limits {
  float open_m, beside_m;
};

[[nodiscard]] Limits limits_at(float range_m, float confidence) {
  const float open_m = std::min(kMaxOpenM, kOpenM + kOpenPerM * range_m);
  const float beside_m = std::min(open_m, kBesideM + kBesidePerM * range_m);
  return {open_m, confidence < kTouching ? -open_m : beside_m};
}

class Labeller {
 public:
  Labeller(const HeightGrid& grid, std::vector<std::uint8_t>& is_ground)
      : grid_(grid), is_ground_(is_ground) {}

  void label(std::span<const CellPoint> points, int cell) {
    look(points, cell);
    const HeightGrid::Node& node = grid_.node(cell);
    const auto x = static_cast<float>(HeightGrid::centre_x(cell));
    const auto y = static_cast<float>(HeightGrid::centre_y(cell));
    const Limits limits = limits_at(std::hypot(x, y), node.confidence);
    for (const Near& p : near_) {
      const float most_m = stands_[p.column] ? limits.beside_m : limits.open_m;
      if (p.above <= most_m && p.above >= -limits.open_m) is_ground_[p.index] = 1;
    }
  }

 private:
  struct Near {
    float above;
    std::uint32_t index;
    std::size_t column;
  };

  /// Finds the points near the surface, and the columns in which something stands.
  void look(std::span<const CellPoint> points, int cell) {
    const HeightGrid::Node& node = grid_.node(cell);
    const auto x0 = static_cast<float>(HeightGrid::centre_x(cell));
    const auto y0 = static_cast<float>(HeightGrid::centre_y(cell));
    near_.clear();
    stands_ = {};
    for (const CellPoint& p : points) {
      const float x = p.x - x0, y = p.y - y0;
      const float above = p.z - node.z - node.slope_x * x - node.slope_y * y;
      if (!(above > -1.0F && above < kStandingToM)) continue;
      const std::size_t column = column_of(x) + kColumns * column_of(y);
      // The blend with the neighbours' planes matters near the surface only.
      if (above > 0.5F) {
        stands_[column] = true;
        continue;
      }
      const float exact = p.z - grid_.height_at(p.x, p.y);
      if (exact > kStandingFromM) {
        stands_[column] = true;
      } else {
        near_.push_back({exact, p.index, column});
      }
    }
  }

  [[nodiscard]] static std::size_t column_of(float from_centre) {
    constexpr auto kPerMetre = static_cast<float>(kColumns / HeightGrid::kCellM);
    const int column = static_cast<int>(from_centre * kPerMetre + 0.5F * kColumns);
    return static_cast<std::size_t>(std::clamp(column, 0, kColumns - 1));
  }

  const HeightGrid& grid_;
  std::vector<std::uint8_t>& is_ground_;
  std::vector<Near> near_;
  std::array<bool, static_cast<std::size_t>(kColumns) * kColumns> stands_{};
};

}  // namespace

void label_ground(const CellPoints& points, const HeightGrid& grid,
                  std::vector<std::uint8_t>& is_ground) {
  Labeller labeller(grid, is_ground);
  for (const int cell : points.near_to_far()) {
    if (grid.node(cell).confidence > 0.0F) labeller.label(points.of_cell(cell), cell);
  }
}

}  // namespace stillmap::mapping

#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wfloat-conversion"
#include "ground/point_labels.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr float kStandingFromM = 0.3F;
constexpr float kStandingToM = 3.0F;
/// Parts of a cell's side that are looked at apart.
const int kParts = getenv("PARTS") ? atoi(getenv("PARTS")) : 4;const float kConf = getenv("CONF") ? atof(getenv("CONF")) : 0.85; const float kFilled = getenv("FILLED") ? atof(getenv("FILLED")) : -1;
float kTightM = getenv("TIGHT") ? atof(getenv("TIGHT")) : 0.04F;
float kTightPerM = getenv("TIGHTM") ? atof(getenv("TIGHTM")) : 0.001F;

}  // namespace

void label_ground(const CellPoints& points, const HeightGrid& grid,
                  std::vector<std::uint8_t>& is_ground) {
  std::vector<float> above;
  std::vector<int> part;
  for (const int cell : points.near_to_far()) {
    if (grid.node(cell).confidence <= 0.0F) continue;
    const auto of_cell = points.of_cell(cell);
    above.resize(of_cell.size());
    part.resize(of_cell.size());
    std::array<bool, 64> stands{};
    const auto x0 = static_cast<float>(HeightGrid::centre_x(cell) - 0.5 * HeightGrid::kCellM);
    const auto y0 = static_cast<float>(HeightGrid::centre_y(cell) - 0.5 * HeightGrid::kCellM);
    for (std::size_t i = 0; i < of_cell.size(); ++i) {
      const CellPoint& p = of_cell[i];
      above[i] = 10.0F;
      if (p.z > grid.node(cell).z + 3.5F) continue;
      const auto sample = grid.at(static_cast<double>(p.x), static_cast<double>(p.y));
      above[i] = static_cast<float>((static_cast<double>(p.z) - sample->z) * sample->normal.z());
      const int ix = std::clamp(static_cast<int>((p.x - x0) * kParts), 0, kParts - 1);
      const int iy = std::clamp(static_cast<int>((p.y - y0) * kParts), 0, kParts - 1);
      part[i] = iy * kParts + ix;
      if (above[i] > kStandingFromM && above[i] < kStandingToM) stands[static_cast<std::size_t>(part[i])] = true;
    }
    const float range_m = std::hypot(x0, y0);
    const float loose = std::min(0.25F, 0.15F + 0.0015F * range_m);
    const float tight = std::min(loose, kTightM + kTightPerM * range_m) * (grid.node(cell).confidence < kConf ? kFilled : 1.0F);
    for (std::size_t i = 0; i < of_cell.size(); ++i) {
      if (above[i] < -loose || above[i] > loose) continue;
      if (above[i] <= (stands[static_cast<std::size_t>(part[i])] ? tight : loose)) is_ground[of_cell[i].index] = 1;
    }
  }
}

}  // namespace stillmap::mapping

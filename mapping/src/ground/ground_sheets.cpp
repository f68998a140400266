#include "ground/ground_sheets.hpp"

#include <cmath>
#include <tuple>

namespace stillmap::mapping {
namespace {

/// Sheets of neighbouring blocks whose means differ by more are not one ground [m]: the lowest
/// bridges are higher, and no street rises as much over 4 m.
constexpr float kSameSheetM = 2.0F;
/// How far a place may lie above the point that asks [m]: tyres that sank in, wrong poses.
constexpr double kAboveM = 0.5;

}  // namespace

std::uint32_t GroundSheets::add(std::int32_t block_x, std::int32_t block_y) {
  const auto number = static_cast<std::uint32_t>(sheets_.size());
  Sheet& sheet = sheets_.push_back({});
  sheet.block_x = block_x;
  sheet.block_y = block_y;
  sheet.around.fill(kNone);
  sheet.around[4] = number;
  const auto [first, fresh] = first_.insert(maps::plane_cell_key(block_x, block_y), number);
  next_.push_back(fresh ? kNone : *first);
  *first = number;
  return number;
}

std::uint32_t GroundSheets::nearest_in(std::int32_t block_x, std::int32_t block_y, float z) const {
  const std::uint32_t* first = first_.find(maps::plane_cell_key(block_x, block_y));
  if (first == nullptr) return kNone;
  std::uint32_t nearest = kNone;
  float least = kSameSheetM;
  for (std::uint32_t s = *first; s != kNone; s = next_[s]) {
    const float away = std::abs(sheets_[s].mean_z - z);
    if (away > least) continue;
    nearest = s;
    least = away;
  }
  return nearest;
}

void GroundSheets::join(std::uint32_t sheet) {
  const auto [block_x, block_y, z] =
      std::tuple(sheets_[sheet].block_x, sheets_[sheet].block_y, sheets_[sheet].mean_z);
  for (std::int32_t k = 0; k < 9; ++k) {
    if (k == 4) continue;
    sheets_[sheet].around[static_cast<std::size_t>(k)] =
        nearest_in(block_x + k % 3 - 1, block_y + k / 3 - 1, z);
  }
}

void GroundSheets::join() {
  const auto measured = static_cast<std::uint32_t>(sheets_.size());
  for (std::uint32_t s = 0; s < measured; ++s) {
    const auto [block_x, block_y, z] =
        std::tuple(sheets_[s].block_x, sheets_[s].block_y, sheets_[s].mean_z);
    for (std::int32_t k = 0; k < 9; ++k) {
      const std::int32_t x = block_x + k % 3 - 1;
      const std::int32_t y = block_y + k / 3 - 1;
      if (nearest_in(x, y, z) == kNone) sheets_[add(x, y)].mean_z = z;
    }
    if (maps::rests_after(s)) rest();
  }
  for (std::uint32_t s = 0; s < sheets_.size(); ++s) {
    join(s);
    if (maps::rests_after(s)) rest();
  }
}

std::optional<GroundSheets::Place> GroundSheets::find(int cell_x, int cell_y,
                                                      std::optional<double> z) const {
  const std::uint32_t* first = first_.find(maps::plane_cell_key(cell_x >> 4, cell_y >> 4));
  if (first == nullptr) return std::nullopt;
  const int number = (cell_y & 15) * kSide + (cell_x & 15);
  std::optional<Place> best;
  double best_rank = 0.0;
  for (std::uint32_t s = *first; s != kNone; s = next_[s]) {
    const Place place{s, number};
    const GroundNode& n = node(place);
    if (n.state == GroundState::kUnknown) continue;
    // Of those not above: the higher, the better. Those above come last, the lowest first.
    const double height = static_cast<double>(n.z);
    const bool above = z && height > *z + kAboveM;
    const double rank = !z      ? static_cast<double>(sheets_[s].weight)
                        : above ? -1e9 - height
                                : height;
    if (best && rank <= best_rank) continue;
    best = place;
    best_rank = rank;
  }
  return best;
}

}  // namespace stillmap::mapping

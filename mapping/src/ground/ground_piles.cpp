#include "ground/ground_piles.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Scans within this agree on a layer [m]: poses that drift, not the two sides of a kerb.
constexpr float kPileLayerM = 0.08F;
/// Heights of one pile [m]; the lowest bridges and parking decks are higher than that.
constexpr float kPileM = 2.0F;
/// A tyre in front of the camera must not outweigh the road that another scan saw there.
constexpr float kInBoxWeight = 0.1F;
/// What a pile must have to be a level of its own.
constexpr int kLevelCells = 64;
constexpr float kLevelWeight = 0.1F;

float weight_of(const GroundPile& pile) {
  float weight = 0.0F;
  for (const GroundCellSum& cell : pile.cells) weight += cell.weight;
  return weight;
}

int count_of(const GroundPile& pile) {
  return static_cast<int>(std::count_if(pile.cells.begin(), pile.cells.end(),
                                        [](const auto& cell) { return cell.weight > 0.0F; }));
}

int overlap_of(const GroundPile& a, const GroundPile& b) {
  int count = 0;
  for (std::size_t k = 0; k < a.cells.size(); ++k)
    count += a.cells[k].weight > 0.0F && b.cells[k].weight > 0.0F ? 1 : 0;
  return count;
}

/// Joins the piles of one block into sheets; see `GroundPiles::take_sheets`.
void join(std::vector<std::uint32_t> block, GroundPiles::Sheets& sheets) {
  maps::ScratchVector<GroundPile>& piles = sheets.piles;
  std::vector<std::uint32_t>& numbers = sheets.numbers;
  std::stable_sort(block.begin(), block.end(), [&](std::uint32_t a, std::uint32_t b) {
    return weight_of(piles[a]) > weight_of(piles[b]);
  });
  const std::size_t first = numbers.size();
  for (const std::uint32_t number : block) {
    const GroundPile& pile = piles[number];
    const int count = count_of(pile);
    bool joined = false;
    for (std::size_t s = first; s < numbers.size() && !joined; ++s) {
      GroundPile& sheet = piles[numbers[s]];
      if (4 * overlap_of(sheet, pile) > count) continue;
      for (std::size_t k = 0; k < pile.cells.size(); ++k) {
        if (pile.cells[k].weight > sheet.cells[k].weight) sheet.cells[k] = pile.cells[k];
      }
      joined = true;
    }
    if (joined) continue;
    const bool light = numbers.size() > first && count < kLevelCells &&
                       weight_of(pile) < kLevelWeight * weight_of(piles[numbers[first]]);
    if (!light) numbers.push_back(number);
  }
}

}  // namespace

void GroundCellSum::add(const GroundCells::Cell& cell) {
  const float w = cell.in_box ? kInBoxWeight * cell.weight : cell.weight;
  const float trust = cell.in_box ? 0.0F : w;
  if (weight == 0.0F || std::abs(cell.z - z) <= kPileLayerM) {
    const float share = w / (weight + w);
    z += share * (cell.z - z);
    offset_x += share * (cell.offset_x - offset_x);
    offset_y += share * (cell.offset_y - offset_y);
    weight += w;
    trusted += trust;
    return;
  }
  if (other_weight > 0.0F && std::abs(cell.z - other_z) <= kPileLayerM) {
    other_z += w / (other_weight + w) * (cell.z - other_z);
    other_weight += w;
    other_trusted += trust;
  } else if (w >= other_weight) {
    other_z = cell.z;
    other_weight = w - other_weight;
    other_trusted = trust;
  } else {
    other_trusted *= 1.0F - w / other_weight;
    other_weight -= w;
  }
  if (other_weight <= weight) return;
  std::swap(z, other_z);
  std::swap(weight, other_weight);
  std::swap(trusted, other_trusted);
  offset_x = offset_y = 0.0F;
}

GroundPile& GroundPiles::pile_for(std::int32_t block_x, std::int32_t block_y, float z) {
  const auto number = static_cast<std::uint32_t>(piles_.size());
  const auto [first, fresh] = first_.insert(maps::plane_cell_key(block_x, block_y), number);
  if (!fresh) {
    for (std::uint32_t p = *first; p != GroundSheets::kNone; p = next_[p]) {
      if (std::abs(piles_[p].anchor_z - z) <= kPileM) return piles_[p];
    }
  } else {
    blocks_.push_back(number);
  }
  GroundPile& pile = piles_.push_back({});
  pile.block_x = block_x;
  pile.block_y = block_y;
  pile.anchor_z = z;
  next_.push_back(GroundSheets::kNone);
  if (!fresh) {
    std::uint32_t last = *first;
    while (next_[last] != GroundSheets::kNone) last = next_[last];
    next_[last] = number;
  }
  return pile;
}

void GroundPiles::add(const GroundCells& ground) {
  GroundPile* pile = nullptr;
  for (const GroundCells::Cell& cell : ground.cells) {
    const std::int32_t block_x = cell.x >> 4;
    const std::int32_t block_y = cell.y >> 4;
    const bool same = pile != nullptr && pile->block_x == block_x && pile->block_y == block_y &&
                      std::abs(pile->anchor_z - cell.z) <= kPileM;
    if (!same) pile = &pile_for(block_x, block_y, cell.z);
    pile->cells[static_cast<std::size_t>((cell.y & 15) * GroundSheets::kSide + (cell.x & 15))].add(
        cell);
  }
}

GroundPiles::Sheets GroundPiles::take_sheets() && {
  Sheets sheets{std::move(piles_), {}};
  sheets.numbers.reserve(blocks_.size());
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    std::vector<std::uint32_t> piles;
    for (std::uint32_t p = blocks_[i]; p != GroundSheets::kNone; p = next_[p]) piles.push_back(p);
    join(std::move(piles), sheets);
    if (maps::rests_after(i)) sheets.piles.rest();
  }
  next_.clear();
  first_.clear();
  blocks_.clear();
  return sheets;
}

}  // namespace stillmap::mapping

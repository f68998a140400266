#include "ground/ground_spread.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr int kSide = GroundSheets::kSide;
constexpr auto kCell = static_cast<float>(kGroundCellM);
constexpr std::uint8_t kReachCells = 40;
constexpr int kIronings = 6;

[[nodiscard]] bool is_source(const GroundNode& node) {
  return node.state == GroundState::kKnown || node.state == GroundState::kFilled;
}

/// What the cells around say about one that was not measured.
std::optional<GroundNode> from_around(const MeasuredSheets& ground, GroundSheets::Place here) {
  const int x = here.node % kSide;
  const int y = here.node / kSide;
  float weight = 0.0F, z = 0.0F, slope_x = 0.0F, slope_y = 0.0F, confidence = 0.0F;
  for (int dy = -2; dy <= 2; ++dy) {
    for (int dx = -2; dx <= 2; ++dx) {
      const auto there = ground.sheets.beside(here.sheet, x + dx, y + dy);
      if (there.sheet == GroundSheets::kNone) continue;
      const GroundNode& n = ground.sheets.node(there);
      if (!is_source(n)) continue;
      const auto d2 = static_cast<float>(dx * dx + dy * dy);
      const float w = 1.0F / d2;
      weight += w;
      z += w * (n.z -
                kCell * (n.slope_x * static_cast<float>(dx) + n.slope_y * static_cast<float>(dy)));
      slope_x += w * n.slope_x;
      slope_y += w * n.slope_y;
      confidence += w * static_cast<float>(n.confidence_255);
    }
  }
  if (weight <= 0.0F) return std::nullopt;
  GroundNode node;
  node.z = z / weight;
  node.slope_x = slope_x / weight;
  node.slope_y = slope_y / weight;
  node.confidence_255 = static_cast<std::uint8_t>(confidence / weight);
  node.state = GroundState::kFilled;
  return node;
}

using Places = maps::ScratchVector<GroundSheets::Place>;

/// What spreading needs for each cell.
struct Spreading {
  explicit Spreading(const std::filesystem::path& scratch)
      : ring(scratch), last(scratch), filled(scratch), nodes(scratch), seen(scratch) {}

  Places ring, last, filled;
  /// Of the ring's places.
  maps::ScratchVector<GroundNode> nodes;
  /// One a cell.
  maps::ScratchVector<std::uint8_t> seen;

  /// In a pass over places, of which a ring has some 8 in a sheet.
  void stepped(const MeasuredSheets& ground, std::size_t place) const {
    constexpr std::size_t kPlacesOfSheet = 8;
    if (place % kPlacesOfSheet != 0 || !maps::rests_after(place / kPlacesOfSheet)) return;
    ground.stepped(place / kPlacesOfSheet);
    for (const Places* places : {&ring, &last, &filled}) places->rest();
    nodes.rest();
    seen.rest();
  }
};

/// Makes the ring of places next to the last one that are no source yet, each once, in a fixed
/// order.
void ring_around_last(const MeasuredSheets& ground, Spreading& spreading) {
  spreading.ring.clear();
  for (std::size_t i = 0; i < spreading.last.size(); ++i) {
    spreading.stepped(ground, i);
    const GroundSheets::Place place = spreading.last[i];
    const int x = place.node % kSide;
    const int y = place.node / kSide;
    for (int k = 0; k < 9; ++k) {
      const auto there = ground.sheets.beside(place.sheet, x + k % 3 - 1, y + k / 3 - 1);
      if (there.sheet == GroundSheets::kNone || is_source(ground.sheets.node(there))) continue;
      std::uint8_t& mark = spreading.seen[std::size_t{there.sheet} * GroundSheets::kNodes +
                                          static_cast<std::size_t>(there.node)];
      if (mark != 0) continue;
      mark = 1;
      spreading.ring.push_back(there);
    }
  }
}

/// Moves a filled cell to the mean of what its four neighbours' planes say.
void iron(MeasuredSheets& ground, GroundSheets::Place here) {
  constexpr std::array<std::array<int, 2>, 4> kAround = {{{-1, 0}, {1, 0}, {0, -1}, {0, 1}}};
  const int x = here.node % kSide;
  const int y = here.node / kSide;
  float count = 0.0F, z = 0.0F, slope_x = 0.0F, slope_y = 0.0F;
  for (const auto& [dx, dy] : kAround) {
    const auto there = ground.sheets.beside(here.sheet, x + dx, y + dy);
    if (there.sheet == GroundSheets::kNone) continue;
    const GroundNode& n = ground.sheets.node(there);
    if (!is_source(n)) continue;
    count += 1.0F;
    z += n.z - kCell * (n.slope_x * static_cast<float>(dx) + n.slope_y * static_cast<float>(dy));
    slope_x += n.slope_x;
    slope_y += n.slope_y;
  }
  if (count <= 0.0F) return;
  GroundNode& node = ground.sheets.node(here);
  node.z = z / count;
  node.slope_x = slope_x / count;
  node.slope_y = slope_y / count;
}

/// Forgets what was filled; suspects stay suspects.
void start(MeasuredSheets& ground, Places& known) {
  for (std::uint32_t s = 0; s < ground.sheets.size(); ++s) {
    ground.stepped(s);
    for (int k = 0; k < GroundSheets::kNodes; ++k) {
      GroundNode& node = ground.sheets[s].nodes[static_cast<std::size_t>(k)];
      if (node.state == GroundState::kKnown) known.push_back({s, k});
      if (node.state == GroundState::kFilled) node = GroundNode{};
    }
  }
}

}  // namespace

void spread_ground(MeasuredSheets& ground) {
  Spreading spreading(ground.scratch);
  for (std::size_t i = 0; i < ground.sheets.size() * GroundSheets::kNodes; ++i)
    spreading.seen.push_back(0);
  start(ground, spreading.ring);
  const Places& ring = spreading.ring;
  for (std::uint8_t reach = 1; reach <= kReachCells && !ring.empty(); ++reach) {
    std::swap(spreading.ring, spreading.last);
    ring_around_last(ground, spreading);
    spreading.nodes.clear();
    for (std::size_t k = 0; k < ring.size(); ++k) {
      spreading.nodes.push_back(from_around(ground, ring[k]).value_or(GroundNode{}));
      spreading.stepped(ground, k);
    }
    for (std::size_t k = 0; k < ring.size(); ++k) {
      spreading.nodes[k].reach = reach;
      ground.sheets.node(ring[k]) = spreading.nodes[k];
      spreading.filled.push_back(ring[k]);
      spreading.stepped(ground, k);
    }
  }
  for (int round = 0; round < kIronings; ++round) {
    for (std::size_t k = 0; k < spreading.filled.size(); ++k) {
      iron(ground, spreading.filled[k]);
      spreading.stepped(ground, k);
    }
  }
}

std::size_t accept_suspects(MeasuredSheets& ground) {
  std::size_t accepted = 0;
  for (std::uint32_t s = 0; s < ground.measured(); ++s) {
    ground.stepped(s);
    for (int k = 0; k < GroundSheets::kNodes; ++k) {
      const GroundCellSum& cell = ground.pile(s).cells[static_cast<std::size_t>(k)];
      GroundNode& node = ground.sheets[s].nodes[static_cast<std::size_t>(k)];
      if (node.state != GroundState::kFilled || cell.weight <= 0.0F) continue;
      const float spread_z = node.z + node.slope_x * cell.offset_x + node.slope_y * cell.offset_y;
      if (std::abs(cell.z - spread_z) > 0.03F + 0.01F * static_cast<float>(node.reach)) continue;
      node.state = GroundState::kKnown;
      node.reach = 0;
      node.confidence_255 = ground_confidence_255(cell.weight);
      ++accepted;
    }
  }
  return accepted;
}

}  // namespace stillmap::mapping

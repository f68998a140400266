#include "ground/ground_smoothing.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace stillmap::mapping {
namespace {

constexpr int kIslandSide = GroundSheets::kSide;
/// Neighbours that differ by more from the street's slope are not joined [m].
constexpr float kJoinM = 0.12F;
/// 3 m^2 [cells].
constexpr std::uint32_t kIslandCells = 48;
constexpr float kStandsOutM = 0.2F;
/// How far larger ground is looked for [cells].
constexpr int kReach = 4;

/// Union-find over all cells of measured sheets.
class Regions {
 public:
  Regions(std::size_t cells, const std::filesystem::path& scratch)
      : parent_(scratch), size_(scratch) {
    for (std::size_t cell = 0; cell < cells; ++cell) {
      parent_.push_back(static_cast<std::uint32_t>(cell));
      size_.push_back(1);
    }
  }
  void rest() const {
    parent_.rest();
    size_.rest();
  }
  std::uint32_t root(std::uint32_t cell) {
    while (parent_[cell] != cell) {
      parent_[cell] = parent_[parent_[cell]];
      cell = parent_[cell];
    }
    return cell;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    if (a == b) return;
    if (size_[a] < size_[b]) std::swap(a, b);
    parent_[b] = a;
    size_[a] += size_[b];
  }
  std::uint32_t size_of(std::uint32_t cell) { return size_[root(cell)]; }

 private:
  maps::ScratchVector<std::uint32_t> parent_, size_;
};

class Islands {
 public:
  explicit Islands(MeasuredSheets& ground)
      : ground_(ground),
        regions_(std::size_t{ground.measured()} * GroundSheets::kNodes, ground.scratch) {}

  void drop() {
    each_measured([&](std::uint32_t s, int x, int y) {
      join(s, x, y, x + 1, y);
      join(s, x, y, x, y + 1);
    });
    // All is decided before anything is dropped.
    std::vector<std::pair<GroundSheets::Place, float>> dropped;
    each_measured([&](std::uint32_t s, int x, int y) {
      const GroundSheets::Place here{s, y * kIslandSide + x};
      if (regions_.size_of(number_of(here)) >= kIslandCells) return;
      tell(here, x, y);
    });
    for (const auto& [root, vote] : votes_) {
      if (vote.weight > 0.0F) stands_out_[root] = std::abs(vote.sum / vote.weight) > kStandsOutM;
    }
    each_measured([&](std::uint32_t s, int x, int y) {
      const GroundSheets::Place here{s, y * kIslandSide + x};
      const auto found = stands_out_.find(regions_.root(number_of(here)));
      if (found == stands_out_.end() || !found->second) return;
      if (const auto around = height_around(here, x, y))
        dropped.emplace_back(here, *around);
      else
        dropped.emplace_back(here, 1e6F);
    });
    for (const auto& [place, around] : dropped) settle(place, around);
  }

 private:
  struct Vote {
    float sum = 0.0F;
    float weight = 0.0F;
  };

  [[nodiscard]] static std::uint32_t number_of(GroundSheets::Place place) {
    return place.sheet * GroundSheets::kNodes + static_cast<std::uint32_t>(place.node);
  }

  template <typename Use>
  void each_measured(const Use& use) {
    for (std::uint32_t s = 0; s < ground_.measured(); ++s) {
      ground_.stepped(s);
      if (maps::rests_after(s)) regions_.rest();
      for (int k = 0; k < GroundSheets::kNodes; ++k) {
        if (ground_.sheets[s].nodes[static_cast<std::size_t>(k)].measured())
          use(s, k % kIslandSide, k / kIslandSide);
      }
    }
  }

  void join(std::uint32_t sheet, int x, int y, int to_x, int to_y) {
    const GroundSheets::Place there = ground_.sheets.beside(sheet, to_x, to_y);
    if (there.sheet == GroundSheets::kNone || !ground_.sheets.node(there).measured()) return;
    const GroundSheets::Place here{sheet, y * kIslandSide + x};
    const Eigen::Vector2f step(static_cast<float>(to_x - x), static_cast<float>(to_y - y));
    const float rise = ground_.sheets.node(there).z - ground_.sheets.node(here).z -
                       static_cast<float>(kGroundCellM) * ground_.slopes[sheet].dot(step);
    if (std::abs(rise) <= kJoinM) regions_.join(number_of(here), number_of(there));
  }

  /// Height that larger ground within reach has here, carried along the street's slope.
  [[nodiscard]] std::optional<float> height_around(GroundSheets::Place here, int x, int y) {
    float sum = 0.0F, weight = 0.0F;
    for (int dy = -kReach; dy <= kReach; ++dy) {
      for (int dx = -kReach; dx <= kReach; ++dx) {
        const auto there = ground_.sheets.beside(here.sheet, x + dx, y + dy);
        if (there.sheet >= ground_.measured()) continue;
        const GroundNode& node = ground_.sheets.node(there);
        if (!node.measured() || regions_.size_of(number_of(there)) < kIslandCells) continue;
        const Eigen::Vector2f step(static_cast<float>(dx), static_cast<float>(dy));
        const float w = 1.0F / (1.0F + step.squaredNorm());
        sum +=
            w * (node.z - static_cast<float>(kGroundCellM) * ground_.slopes[here.sheet].dot(step));
        weight += w;
      }
    }
    if (weight <= 0.0F) return std::nullopt;
    return sum / weight;
  }

  void tell(GroundSheets::Place here, int x, int y) {
    const auto around = height_around(here, x, y);
    if (!around) return;
    Vote& vote = votes_[regions_.root(number_of(here))];
    vote.sum += ground_.sheets.node(here).z - *around;
    vote.weight += 1.0F;
  }

  void settle(GroundSheets::Place place, float around) {
    GroundNode& node = ground_.sheets.node(place);
    GroundCellSum& cell = ground_.pile(place.sheet).cells[static_cast<std::size_t>(place.node)];
    if (cell.other_weight > 0.0F && std::abs(cell.other_z - around) <= kStandsOutM) {
      cell.z = node.z = cell.other_z;
      cell.weight = cell.other_weight;
      cell.trusted = cell.other_trusted;
      cell.offset_x = cell.offset_y = 0.0F;
      node.state = cell.trusted > 0.0F ? GroundState::kKnown : GroundState::kSuspect;
    } else {
      cell = GroundCellSum{};
      node = GroundNode{};
    }
  }

  MeasuredSheets& ground_;
  Regions regions_;
  std::unordered_map<std::uint32_t, Vote> votes_;
  std::unordered_map<std::uint32_t, bool> stands_out_;
};

}  // namespace

void drop_islands(MeasuredSheets& ground) { Islands(ground).drop(); }

}  // namespace stillmap::mapping

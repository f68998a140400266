#include "ground/ground_smoothing.hpp"

#include <stillmap/maps/median.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr int kSheetSide = GroundSheets::kSide;
constexpr auto kSmoothingCellM = static_cast<float>(kGroundCellM);
/// Pairs of cells this far apart tell the slope of a street [cells].
constexpr int kPairCells = 4;
constexpr std::size_t kMinPairs = 16;
/// Slopes beyond are none of a street and its banks.
constexpr float kMaxGroundSlope = 1.0F;

const GroundCellSum* sum_at(const MeasuredSheets& ground, GroundSheets::Place place) {
  if (place.sheet >= ground.measured()) return nullptr;
  return &ground.pile(place.sheet).cells[static_cast<std::size_t>(place.node)];
}

/// Median rise over 1 m along one axis: where a kerb crosses, most pairs do not cross it.
std::optional<float> rise_along(const MeasuredSheets& ground, std::uint32_t sheet, int dx, int dy) {
  std::vector<float> rises;
  for (int y = 0; y < kSheetSide; ++y) {
    for (int x = 0; x < kSheetSide; ++x) {
      const GroundSheets::Place here{sheet, y * kSheetSide + x};
      const auto there = ground.sheets.beside(sheet, x + dx, y + dy);
      if (there.sheet == GroundSheets::kNone) continue;
      const GroundCellSum* a = sum_at(ground, here);
      const GroundCellSum* b = sum_at(ground, there);
      if (a == nullptr || b == nullptr || a->weight <= 0.0F || b->weight <= 0.0F) continue;
      rises.push_back(b->z - a->z);
    }
  }
  if (rises.size() < kMinPairs) return std::nullopt;
  constexpr float kPairM = kPairCells * kSmoothingCellM;
  return std::clamp(maps::median(std::move(rises)) / kPairM, -kMaxGroundSlope, kMaxGroundSlope);
}

/// Slopes of the sheets that have enough of their own; the others take the mean of those around.
void find_slopes(MeasuredSheets& ground) {
  const std::size_t count = ground.sheets.size();
  ground.slopes.assign(count, Eigen::Vector2f::Zero());
  std::vector<std::uint8_t> known(count, 0);
  for (std::uint32_t s = 0; s < ground.measured(); ++s) {
    ground.stepped(s);
    const auto x = rise_along(ground, s, kPairCells, 0);
    const auto y = rise_along(ground, s, 0, kPairCells);
    if (!x || !y) continue;
    ground.slopes[s] = {*x, *y};
    known[s] = 1;
  }
  for (int round = 0; round < 3; ++round) {
    const std::vector<std::uint8_t> before = known;
    for (std::uint32_t s = 0; s < count; ++s) {
      ground.stepped(s);
      if (before[s] != 0) continue;
      Eigen::Vector2f sum = Eigen::Vector2f::Zero();
      float around = 0.0F;
      for (const std::uint32_t n : ground.sheets[s].around) {
        if (n == GroundSheets::kNone || before[n] == 0) continue;
        sum += ground.slopes[n];
        around += 1.0F;
      }
      if (around <= 0.0F) continue;
      ground.slopes[s] = sum / around;
      known[s] = 1;
    }
  }
}

/// Weighted normal equations of z = a + b x + c y.
struct NodeSums {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();

  void add(double w, double x, double y, double z) {
    const Eigen::Vector3d row(1.0, x, y);
    A += w * row * row.transpose();
    b += w * z * row;
  }
};

void smooth(MeasuredSheets& ground, std::uint32_t sheet, int x, int y) {
  const GroundCellSum& cell =
      ground.pile(sheet).cells[static_cast<std::size_t>(y * kSheetSide + x)];
  const Eigen::Vector2f slope = ground.slopes[sheet];
  const Eigen::Vector2f at(cell.offset_x, cell.offset_y);
  NodeSums sums;
  double weight = 0.0;
  for (int dy = -2; dy <= 2; ++dy) {
    for (int dx = -2; dx <= 2; ++dx) {
      const auto there = ground.sheets.beside(sheet, x + dx, y + dy);
      if (there.sheet == GroundSheets::kNone) continue;
      if (ground.sheets.node(there).state != GroundState::kKnown) continue;
      const GroundCellSum& other = *sum_at(ground, there);
      const Eigen::Vector2f p(kSmoothingCellM * static_cast<float>(dx) + other.offset_x,
                              kSmoothingCellM * static_cast<float>(dy) + other.offset_y);
      const float d2 = (p - at).squaredNorm();
      const float rise = other.z - cell.z - slope.dot(p - at);
      if (std::abs(rise) > 0.04F + 0.1F * std::sqrt(d2)) continue;
      const auto w = static_cast<double>(std::min(other.weight, 2.0F)) *
                     std::exp(-static_cast<double>(d2) / (2.0 * 0.3 * 0.3));
      sums.add(w, static_cast<double>(p.x()), static_cast<double>(p.y()),
               static_cast<double>(other.z));
      weight += w;
    }
  }
  // Without a prior the slope across a lone row of cells would be free.
  const double pull = 0.02 * weight;
  sums.A(1, 1) += pull;
  sums.A(2, 2) += pull;
  sums.b.tail<2>() += pull * slope.cast<double>();
  const Eigen::Vector3f plane = maps::ldlt_solve(sums.A, sums.b).cast<float>();
  GroundNode& node = ground.sheets[sheet].nodes[static_cast<std::size_t>(y * kSheetSide + x)];
  node.z = plane.x();
  node.slope_x = plane.y();
  node.slope_y = plane.z();
}

}  // namespace

std::uint8_t ground_confidence_255(float weight) {
  // One point at 25 m weighs 0.07, one within a box of an object 0.01.
  constexpr float kHalf = 0.02F;
  return static_cast<std::uint8_t>(255.0F * weight / (weight + kHalf));
}

MeasuredSheets sheets_of(GroundPiles::Sheets piles, const std::filesystem::path& scratch) {
  MeasuredSheets ground{GroundSheets(scratch), std::move(piles), {}, scratch};
  for (std::uint32_t s = 0; s < ground.measured(); ++s) {
    ground.stepped(s);
    const GroundPile& pile = ground.pile(s);
    GroundSheets::Sheet& sheet = ground.sheets[ground.sheets.add(pile.block_x, pile.block_y)];
    double sum = 0.0, z = 0.0;
    for (std::size_t k = 0; k < pile.cells.size(); ++k) {
      const GroundCellSum& cell = pile.cells[k];
      if (cell.weight <= 0.0F) continue;
      GroundNode& node = sheet.nodes[k];
      node.z = cell.z;
      node.state = cell.trusted > 0.0F ? GroundState::kKnown : GroundState::kSuspect;
      node.confidence_255 = ground_confidence_255(cell.weight);
      sum += static_cast<double>(cell.weight);
      z += static_cast<double>(cell.weight) * static_cast<double>(cell.z);
    }
    sheet.weight = static_cast<float>(sum);
    sheet.mean_z = static_cast<float>(z / sum);
  }
  ground.sheets.join();
  find_slopes(ground);
  return ground;
}

void smooth_measured(MeasuredSheets& ground) {
  for (std::uint32_t s = 0; s < ground.measured(); ++s) {
    ground.stepped(s);
    for (int k = 0; k < GroundSheets::kNodes; ++k) {
      if (ground.sheets[s].nodes[static_cast<std::size_t>(k)].state == GroundState::kKnown)
        smooth(ground, s, k % kSheetSide, k / kSheetSide);
    }
  }
}

}  // namespace stillmap::mapping

#include "loops/scan_context.hpp"

#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

namespace stillmap::mapping {
namespace {

using ContextColumns = Eigen::Matrix<float, kContextRings, kContextSectors>;

using Bins = ContextColumns;

/// The ground is looked for in so many rings (20 m).
constexpr int kNearRings = 5;

struct Bin {
  int ring = 0;
  int sector = 0;
};

/// None beyond the reach.
std::optional<Bin> bin_of(const Eigen::Vector3f& p) {
  constexpr auto kRingM = static_cast<float>(kContextReachM / kContextRings);
  constexpr float kSectorRad = 2.0F * std::numbers::pi_v<float> / kContextSectors;
  const float range_m = p.head<2>().norm();
  if (!(range_m < static_cast<float>(kContextReachM))) return std::nullopt;
  const float turned_rad = std::atan2(p.y(), p.x()) + std::numbers::pi_v<float>;
  return Bin{std::min(static_cast<int>(range_m / kRingM), kContextRings - 1),
             static_cast<int>(turned_rad / kSectorRad) % kContextSectors};
}

/// Height of the ground around the sensor: median of the lowest points of the bins of so many
/// rings, at least half of which see it; infinite without a point.
float ground_height_m(const Bins& lowest_m, int rings) {
  std::vector<float> heights;
  for (const float height : lowest_m.topRows(rings).reshaped()) {
    if (std::isfinite(height)) heights.push_back(height);
  }
  if (heights.empty()) return std::numeric_limits<float>::infinity();
  return maps::median(std::move(heights));
}

/// Columns of length one, or zero where nothing stands.
ContextColumns unit_columns(const ScanContext& context) {
  ContextColumns out = context.heights_m;
  for (int j = 0; j < kContextSectors; ++j) {
    const float norm = out.col(j).norm();
    if (norm > 0.0F) out.col(j) /= norm;
  }
  return out;
}

}  // namespace

int ScanContext::seen_sectors() const {
  return static_cast<int>((heights_m.colwise().maxCoeff().array() > 0.0F).count());
}

ScanContext describe(const std::vector<Eigen::Vector3f>& points_level) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  Bins lowest_m = Bins::Constant(kInfinity);
  Bins highest_m = Bins::Constant(-kInfinity);
  for (const Eigen::Vector3f& p : points_level) {
    const std::optional<Bin> bin = bin_of(p);
    if (!bin) continue;
    float& lowest = lowest_m(bin->ring, bin->sector);
    float& highest = highest_m(bin->ring, bin->sector);
    lowest = std::min(lowest, p.z());
    highest = std::max(highest, p.z());
  }
  float ground_m = ground_height_m(lowest_m, kNearRings);
  // A sensor that looks ahead alone sees no ground near by.
  if (std::isinf(ground_m)) ground_m = ground_height_m(lowest_m, kContextRings);
  ScanContext context;
  // Without any point: - infinity, which is no height above any ground.
  context.heights_m = (highest_m.array() - ground_m).cwiseMax(0.0F);
  return context;
}

RingKey ring_key(const ScanContext& context) { return context.heights_m.rowwise().mean(); }

ContextDistance distance_between(const ScanContext& a, const ScanContext& b) {
  const ContextColumns unit_a = unit_columns(a);
  const ContextColumns unit_b = unit_columns(b);
  const Eigen::Matrix<float, kContextSectors, kContextSectors> cosines =
      unit_a.transpose() * unit_b;
  const Eigen::Array<bool, 1, kContextSectors> seen_a =
      a.heights_m.colwise().maxCoeff().array() > 0.0F;
  const Eigen::Array<bool, 1, kContextSectors> seen_b =
      b.heights_m.colwise().maxCoeff().array() > 0.0F;
  ContextDistance best;
  for (int shift = 0; shift < kContextSectors; ++shift) {
    double sum = 0.0;
    int seen = 0;
    for (int j = 0; j < kContextSectors; ++j) {
      const int turned = (j + shift) % kContextSectors;
      sum += static_cast<double>(cosines(j, turned));
      if (seen_a[j] || seen_b[turned]) ++seen;
    }
    const double distance = seen == 0 ? 1.0 : std::clamp(1.0 - sum / seen, 0.0, 1.0);
    if (distance < best.distance) best = {distance, shift};
  }
  return best;
}

}  // namespace stillmap::mapping

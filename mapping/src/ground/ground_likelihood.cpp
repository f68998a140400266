#include "ground/ground_likelihood.hpp"

#include <cmath>
#include <numeric>

namespace stillmap::mapping {
namespace {

/// cos 45 degrees.
constexpr double kUpright = 0.707;
/// Patchwork's fixed thresholds [m] and [m^2].
constexpr std::array<double, GroundLikelihood::kRingsOfInterest> kFirstElevation = {0.523, 0.746,
                                                                                    0.879, 1.125};
constexpr std::array<double, GroundLikelihood::kRingsOfInterest> kFirstFlatness = {0.0005, 0.000725,
                                                                                   0.001, 0.001};
/// a_m and b_m of the paper, as in the authors' program.
constexpr std::array<double, GroundLikelihood::kRingsOfInterest> kElevationSpread = {3.0, 2.0, 2.0,
                                                                                     2.0};
constexpr double kFlatnessSpread = 1.0;
constexpr double kRevertSpread = 1.5;
/// Longer than wide by sqrt(8): rather a line than a patch of ground.
constexpr double kLineRatio = 8.0;
constexpr std::size_t kFewest = 20;
constexpr std::size_t kMost = 1000;

struct Spread {
  double mean = 0.0;
  double deviation = 0.0;
};

template <typename Values>
[[nodiscard]] Spread spread_of(const Values& values) {
  Spread spread;
  const auto n = static_cast<double>(values.size());
  if (values.empty()) return spread;
  spread.mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double squares = 0.0;
  for (const double v : values) squares += (v - spread.mean) * (v - spread.mean);
  if (values.size() > 1) spread.deviation = std::sqrt(squares / (n - 1.0));
  return spread;
}

[[nodiscard]] bool is_near(const LikelihoodInput& patch) {
  return patch.ring < GroundLikelihood::kRingsOfInterest;
}

/// The sensor is on the upper side of the plane.
[[nodiscard]] bool faces(const PlaneFit& plane, double sensor_height_m) {
  const Eigen::Vector3d sensor(0.0, 0.0, sensor_height_m);
  return plane.normal.dot(plane.mean - sensor) < 0.0;
}

}  // namespace

GroundLikelihood::GroundLikelihood() : elevation_(kFirstElevation), flatness_(kFirstFlatness) {}

bool GroundLikelihood::is_low(const LikelihoodInput& patch) const {
  return patch.plane.mean.z() < elevation_threshold_m(patch.ring);
}

std::vector<PatchVerdict> GroundLikelihood::judge(std::span<const LikelihoodInput> patches,
                                                  double sensor_height_m) const {
  std::vector<PatchVerdict> verdicts(patches.size(), PatchVerdict::kRefused);
  std::array<std::vector<double>, kRingsOfInterest> certain;
  std::vector<std::size_t> candidates;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const LikelihoodInput& patch = patches[i];
    if (!(patch.plane.uprightness() > kUpright)) continue;
    if (!is_near(patch)) {
      verdicts[i] = PatchVerdict::kGround;
      continue;
    }
    if (!faces(patch.plane, sensor_height_m)) continue;
    if (is_low(patch)) {
      certain[static_cast<std::size_t>(patch.ring)].push_back(patch.plane.flatness);
      verdicts[i] = PatchVerdict::kGround;
    } else if (patch.plane.flatness < flatness_threshold_m2(patch.ring)) {
      verdicts[i] = PatchVerdict::kGround;
    } else {
      candidates.push_back(i);
    }
  }
  for (const std::size_t i : candidates) {
    const PlaneFit& plane = patches[i].plane;
    const Spread ring = spread_of(certain[static_cast<std::size_t>(patches[i].ring)]);
    if (plane.line_ratio() <= kLineRatio &&
        plane.flatness < ring.mean + kRevertSpread * ring.deviation)
      verdicts[i] = PatchVerdict::kGround;
  }
  return verdicts;
}

void GroundLikelihood::learn(std::span<const LikelihoodInput> patches) {
  for (const LikelihoodInput& patch : patches) {
    if (!is_near(patch) || !(patch.plane.uprightness() > kUpright) || !is_low(patch)) continue;
    const auto ring = static_cast<std::size_t>(patch.ring);
    seen_elevation_[ring].push_back(patch.plane.mean.z());
    seen_flatness_[ring].push_back(patch.plane.flatness);
    if (seen_elevation_[ring].size() <= kMost) continue;
    seen_elevation_[ring].pop_front();
    seen_flatness_[ring].pop_front();
  }
  for (std::size_t ring = 0; ring < kRingsOfInterest; ++ring) {
    if (seen_elevation_[ring].size() < kFewest) continue;
    const Spread e = spread_of(seen_elevation_[ring]);
    const Spread f = spread_of(seen_flatness_[ring]);
    elevation_[ring] = e.mean + kElevationSpread[ring] * e.deviation;
    flatness_[ring] = f.mean + kFlatnessSpread * f.deviation;
  }
}

}  // namespace stillmap::mapping

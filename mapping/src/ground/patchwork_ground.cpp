#include "ground/patchwork_ground.hpp"

#include <stillmap/maps/median.hpp>

#include "ground/cell_points.hpp"
#include "ground/ground_growth.hpp"
#include "ground/height_grid.hpp"
#include "ground/plane_under_sensor.hpp"
#include "ground/point_labels.hpp"
#include "ground/reflected_noise.hpp"
#include "ground/region_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Gaps are filled this many cells far.
constexpr int kFillReach = 8;
/// What loading, braking and a bump under the vehicle change a given height by [m].
constexpr double kGivenToleranceM = 0.3;
/// The same for a height that was found, also for one that is carried by hand.
constexpr double kFoundToleranceM = 0.5;
/// Fewer scans than this say nothing for those that follow.
constexpr std::size_t kFewestHeights = 3;

/// In the innermost zone, points this share of the sensor's height below the plane seed nothing;
/// from the authors' program.
constexpr double kSeedDepth = 0.2;

/// One scan in levelled coordinates, and the planes of its patches.
struct FittedScan {
  CellPoints points;
  SeedPlane plane;
  std::vector<LikelihoodInput> fits;
  std::vector<int> patch_of_fit;
};

[[nodiscard]] std::optional<FittedScan> fit_patches(const maps::PointCloud& cloud,
                                                    const std::optional<HeightPrior>& prior) {
  CellPoints points(cloud, {});
  const auto plane = find_plane_under_sensor(points, prior);
  if (!plane) return std::nullopt;
  const std::vector<std::uint8_t> noise = find_reflected_noise(cloud, *plane);
  if (!noise.empty()) points = CellPoints(cloud, noise);
  points.level(*plane);
  FittedScan scan{std::move(points), *plane, {}, {}};
  std::vector<CellPoint> scratch;
  for (int patch = 0; patch < ConcentricZones::kPatchCount; ++patch) {
    const int ring = ConcentricZones::ring_of(patch);
    const double deepest_seed_m = ring < ConcentricZones::kRings.front()
                                      ? kSeedDepth * -plane->height
                                      : std::numeric_limits<double>::infinity();
    const auto region = fit_region(scan.points.of_patch(patch), deepest_seed_m, scratch);
    if (!region) continue;
    scan.fits.push_back({region->plane, ring});
    scan.patch_of_fit.push_back(patch);
  }
  return scan;
}

[[nodiscard]] Patches judged(const FittedScan& scan, const GroundLikelihood& likelihood) {
  Patches patches;
  patches.planes.resize(ConcentricZones::kPatchCount);
  patches.verdicts.assign(ConcentricZones::kPatchCount, PatchVerdict::kUnknown);
  const auto verdicts = likelihood.judge(scan.fits, -scan.plane.height);
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const auto patch = static_cast<std::size_t>(scan.patch_of_fit[i]);
    patches.planes[patch] = scan.fits[i].plane;
    patches.verdicts[patch] = verdicts[i];
  }
  return patches;
}

}  // namespace

PatchworkGround::PatchworkGround(const GroundOptions& options)
    : given_height_m_(options.sensor_height_m) {
  if (given_height_m_ && !(*given_height_m_ > 0.0 && std::isfinite(*given_height_m_))) {
    throw std::invalid_argument("sensor_height_m: " + std::to_string(*given_height_m_) +
                                ", > 0 and finite");
  }
}

std::optional<HeightPrior> PatchworkGround::given_prior() const {
  if (!given_height_m_) return std::nullopt;
  return HeightPrior{*given_height_m_, kGivenToleranceM};
}

std::optional<HeightPrior> PatchworkGround::height_prior() const {
  if (given_height_m_) return given_prior();
  if (found_heights_m_.size() < kFewestHeights) return std::nullopt;
  return HeightPrior{maps::median(found_heights_m_), kFoundToleranceM};
}

GroundResult PatchworkGround::segment(const maps::PointCloud& cloud) const {
  GroundResult result;
  result.is_ground.assign(cloud.size(), 0);
  auto grid = std::make_shared<HeightGrid>();
  if (const auto scan = fit_patches(cloud, height_prior())) {
    grow_ground(scan->points, judged(*scan, likelihood_), scan->plane.found_within_m, *grid);
    grid->fill(kFillReach);
    label_ground(scan->points, *grid, result.is_ground);
    grid->tilt(scan->plane);
  }
  result.surface = std::move(grid);
  return result;
}

void PatchworkGround::learn(const maps::PointCloud& cloud) {
  // Heights found so far bind only what is segmented: the first few may be the wrong ones.
  const auto scan = fit_patches(cloud, given_prior());
  if (!scan) return;
  found_heights_m_.push_back(-scan->plane.height);
  likelihood_.learn(scan->fits);
}

std::unique_ptr<GroundSegmenter> make_ground_segmenter(const GroundOptions& options) {
  return std::make_unique<PatchworkGround>(options);
}

}  // namespace stillmap::mapping

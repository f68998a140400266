#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wfloat-conversion"
#include "ground/patchwork_ground.hpp"

#include "ground/ground_growth.hpp"
#include "ground/growing_ground.hpp"
#include "ground/height_grid.hpp"
#include "ground/point_labels.hpp"
#include "ground/reflected_noise.hpp"
#include "ground/region_fit.hpp"
#include "ground/low_points.hpp"

#include <cmath>
#include <algorithm>
#include <cstdlib>

namespace stillmap::mapping {
namespace {

constexpr int kFillReach = 8;

struct FittedScan {
  CellPoints points;
  SeedPlane plane;
  std::vector<LikelihoodInput> fits;
  std::vector<int> patch_of_fit;
};

std::optional<FittedScan> fit_scan(const maps::PointCloud& cloud,
                                   const std::optional<HeightPrior>& prior) {
  CellPoints points(cloud, {});
  const auto plane = find_plane_under_sensor(points, prior);
  if (!plane) return std::nullopt;
  const auto noise = find_reflected_noise(cloud, *plane);
  if (!noise.empty()) points = CellPoints(cloud, noise);
  points.level(*plane);
  FittedScan scan{std::move(points), *plane, {}, {}};
  std::vector<CellPoint> scratch;
  for (int patch = 0; patch < ConcentricZones::kPatchCount; ++patch) {
    const auto region = fit_region(scan.points.of_patch(patch), scratch);
    if (!region) continue;
    scan.fits.push_back({region->plane, ConcentricZones::ring_of(patch)});
    scan.patch_of_fit.push_back(patch);
  }
  return scan;
}

}  // namespace

PatchworkGround::PatchworkGround(const GroundOptions& options)
    : given_height_m_(options.sensor_height_m) {}

std::optional<HeightPrior> PatchworkGround::height_prior() const {
  if (given_height_m_) return HeightPrior{*given_height_m_, 0.3};
  if (seen_heights_m_.size() < 3) return std::nullopt;
  std::vector<double> heights = seen_heights_m_;
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), middle, heights.end());
  return HeightPrior{*middle, 0.5};
}

GroundResult PatchworkGround::segment(const maps::PointCloud& cloud) const {
  GroundResult result;
  result.is_ground.assign(cloud.size(), 0);
  auto grid = std::make_shared<HeightGrid>();
  if (const auto scan = fit_scan(cloud, height_prior())) {
    const auto verdicts = likelihood_.judge(scan->fits, -scan->plane.height);
    Patches patches;
    patches.planes.resize(ConcentricZones::kPatchCount);
    patches.verdicts.assign(ConcentricZones::kPatchCount, PatchVerdict::kUnknown);
    for (std::size_t i = 0; i < verdicts.size(); ++i) {
      const auto patch = static_cast<std::size_t>(scan->patch_of_fit[i]);
      patches.planes[patch] = scan->fits[i].plane;
      patches.verdicts[patch] = verdicts[i];
    }
    if (getenv("PLAIN")) {
      for (int p = 0; p < ConcentricZones::kPatchCount; ++p) {
        if (patches.verdicts[p] != PatchVerdict::kGround) continue;
        for (const CellPoint& q : scan->points.of_patch(p)) {
          const PlaneFit& f = patches.planes[p];
          if (f.normal.dot(Eigen::Vector3d(q.x, q.y, q.z) - f.mean) < 0.125) result.is_ground[q.index] = 1;
        }
      }
    } else {
    grow_ground(scan->points, patches, *grid);
    grid->fill(kFillReach);
    label_ground(scan->points, *grid, result.is_ground);
    grid->tilt(scan->plane);
    }
  }
  result.surface = std::move(grid);
  return result;
}

void PatchworkGround::learn(const maps::PointCloud& cloud) {
  const auto scan = fit_scan(cloud, height_prior());
  if (!scan) return;
  seen_heights_m_.push_back(-scan->plane.height);
  likelihood_.learn(scan->fits);
}

std::unique_ptr<GroundSegmenter> make_ground_segmenter(const GroundOptions& options) {
  if (getenv("OLD")) return std::make_unique<GrowingGround>();
  return std::make_unique<PatchworkGround>(options);
}

}  // namespace stillmap::mapping

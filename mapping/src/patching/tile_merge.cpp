#include "patching/tile_merge.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stillmap::mapping {
namespace {

using maps::TileEvidence;
using Cubes = TileEvidence::Cubes;

/// Cubes of which some drive saw anything.
Cubes seen(const TileEvidence& evidence) {
  Cubes seen;
  for (const TileEvidence::OfDrive& each : evidence.drives) seen |= each.free | each.hit;
  return seen;
}

/// Cubes as they are numbered from another base. Those that have no number there are left out.
/// @param layers  that the base is higher.
Cubes rebased(const Cubes& cubes, int layers) {
  if (layers == 0) return cubes;
  Cubes out;
  for (std::size_t cube = 0; cube < TileEvidence::kCubes; ++cube) {
    if (!cubes[cube]) continue;
    const int layer = static_cast<int>(cube % TileEvidence::kLayers) - layers;
    if (layer >= 0 && layer < TileEvidence::kLayers)
      out.set(static_cast<std::size_t>(static_cast<int>(cube) - layers));
  }
  return out;
}

TileEvidence merged(const TileEvidence& before, const TileEvidence& now) {
  if (now.drives.empty()) return before;
  TileEvidence out{now.base_m, {}};
  const Cubes seen_now = seen(now);
  for (const TileEvidence::OfDrive& each : before.drives) {
    const int layers = now.base_m - before.base_m;
    const Cubes free = rebased(each.free, layers) & ~seen_now;
    const Cubes hit = rebased(each.hit, layers) & ~seen_now;
    if (free.any() || hit.any()) out.drives.push_back({each.drive, free, hit});
  }
  out.drives.insert(out.drives.end(), now.drives.begin(), now.drives.end());
  return out;
}

/// Whether the four cubes around a point, at its height, are free. A thin thing may stand beside
/// the middle of one.
bool is_free(const TileEvidence& evidence, const Cubes& free, const Eigen::Vector3f& p) {
  constexpr double kHalfCubeM = 0.5;
  for (const double dx : {-kHalfCubeM, kHalfCubeM}) {
    for (const double dy : {-kHalfCubeM, kHalfCubeM}) {
      const auto cube = evidence.cube_of(p.cast<double>() + Eigen::Vector3d(dx, dy, 0.0));
      if (!cube || !free[*cube]) return false;
    }
  }
  return true;
}

void append(const TileOfMap& from, std::size_t i, TileOfMap& to) {
  to.points.push_back(from.points[i]);
  if (!from.history.empty()) to.history.push_back(from.history[i]);
}

}  // namespace

MergedTile merged(const TileOfMap& before, const TileOfMap& now, const NearPoints& near_now,
                  double tolerance_m) {
  MergedTile out;
  out.tile.evidence = merged(before.evidence, now.evidence);
  const Cubes free_now = now.evidence.free();
  std::vector<Eigen::Vector3f> measured_before;
  for (std::size_t i = 0; i < before.points.size(); ++i) {
    const maps::MapPoint& point = before.points[i];
    const Eigen::Vector3f p = position_of(point);
    const bool measured = maps::is_measured(point.kind);
    if (near_now.measured.any_within(p, tolerance_m) ||
        (!measured && near_now.others.any_within(p, tolerance_m))) {
      ++out.counts.replaced;
    } else if (point.kind == maps::PointKind::kMeasured && is_free(now.evidence, free_now, p)) {
      ++out.counts.gone;
    } else {
      ++out.counts.kept;
      append(before, i, out.tile);
      if (measured) measured_before.push_back(p);
    }
  }
  const PointCells stays(std::move(measured_before), tolerance_m);
  for (std::size_t i = 0; i < now.points.size(); ++i) {
    const maps::MapPoint& point = now.points[i];
    if (!maps::is_measured(point.kind) && stays.any_within(position_of(point), tolerance_m))
      continue;
    ++out.counts.added;
    append(now, i, out.tile);
  }
  return out;
}

}  // namespace stillmap::mapping

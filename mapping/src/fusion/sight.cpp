#include "fusion/sight.hpp"

#include "fusion/box_frames.hpp"
#include "fusion/track.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr double kCellM = 40.0;
/// The body as shares of the box's height: under it and through its windows rays pass, and boxes
/// begin below the ground.
constexpr double kBodyFrom = 0.3;
constexpr double kBodyTo = 0.65;
/// A box is some decimetres off: points so far outside still are its own, rays so far inside pass
/// it [m].
constexpr double kGrowM = 0.3;
constexpr double kShrinkM = 0.5;
constexpr std::size_t kMinThrough = 10;
constexpr std::size_t kMinThroughSmall = 4;
constexpr std::size_t kThroughOverInside = 4;
constexpr std::size_t kMinPoints = 5;

std::int64_t cell_of(double x) { return static_cast<std::int64_t>(std::floor(x / kCellM)); }

std::uint64_t key_of(std::int64_t x, std::int64_t y) {
  return (static_cast<std::uint64_t>(x) << 32) ^ (static_cast<std::uint64_t>(y) & 0xFFFFFFFFULL);
}

maps::Box body_of(const maps::Box& box) {
  maps::Box body = box;
  body.centre.z() += (0.5 * (kBodyFrom + kBodyTo) - 0.5) * box.size_m.z();
  body.size_m.z() = (kBodyTo - kBodyFrom) * box.size_m.z();
  return body;
}

}  // namespace

SightLines::SightLines(const std::vector<DetectedScan>& scans, const BoxRayCounter& count_rays)
    : scans_(scans), count_rays_(count_rays) {
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (scans[i].drive >= cells_.size()) cells_.resize(scans[i].drive + 1);
    const Eigen::Vector3d p = scans[i].T_map_lidar.translation();
    cells_[scans[i].drive][key_of(cell_of(p.x()), cell_of(p.y()))].push_back(i);
  }
}

Look SightLines::look(std::size_t scan, const maps::Box& box_map) const {
  maps::Box around = body_of(to_lidar(box_map, scans_[scan].T_map_lidar));
  maps::Box core = around;
  around.size_m.head<2>().array() += kGrowM;
  core.size_m.head<2>() =
      (core.size_m.head<2>().array() - kShrinkM).max(0.5 * core.size_m.head<2>().array()).matrix();
  const std::size_t inside = count_rays_(scan, around).inside;
  const std::size_t through = count_rays_(scan, core).through;
  const std::size_t needed = is_small(box_map.object_class) ? kMinThroughSmall : kMinThrough;
  Look out{Sight::kHidden, inside};
  if (through >= needed && through > kThroughOverInside * inside) {
    out.sight = Sight::kFree;
  } else if (inside >= kMinPoints && inside > through) {
    out.sight = Sight::kOccupied;
  }
  return out;
}

bool SightLines::has_points(std::size_t scan, const maps::Box& box_map) const {
  return count_rays_(scan, to_lidar(box_map, scans_[scan].T_map_lidar)).inside > 0;
}

double SightLines::distance_m(std::size_t scan, const Eigen::Vector2d& place) const {
  return (scans_[scan].T_map_lidar.translation().head<2>() - place).norm();
}

double SightLines::travel_m(std::size_t scan_a, std::size_t scan_b) const {
  return (scans_[scan_a].T_map_lidar.translation() - scans_[scan_b].T_map_lidar.translation())
      .norm();
}

std::vector<std::size_t> SightLines::scans_near(std::size_t drive, const Eigen::Vector2d& place,
                                                double reach_m) const {
  std::vector<std::size_t> near;
  if (drive >= cells_.size()) return near;
  const auto& cells = cells_[drive];
  for (std::int64_t x = cell_of(place.x() - reach_m); x <= cell_of(place.x() + reach_m); ++x) {
    for (std::int64_t y = cell_of(place.y() - reach_m); y <= cell_of(place.y() + reach_m); ++y) {
      const auto at = cells.find(key_of(x, y));
      if (at == cells.end()) continue;
      for (const std::size_t scan : at->second) {
        if (distance_m(scan, place) <= reach_m) near.push_back(scan);
      }
    }
  }
  std::sort(near.begin(), near.end());
  return near;
}

}  // namespace stillmap::mapping

#include "fusion/place_look.hpp"

#include "fusion/box_frames.hpp"
#include "fusion/track.hpp"
#include "views/box_rays.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

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
constexpr std::size_t kMinThrough = 6;
constexpr std::size_t kMinThroughSmall = 3;
constexpr std::size_t kThroughOverInside = 4;
constexpr std::size_t kMinOnBody = 3;

std::int64_t cell_of(double x) { return static_cast<std::int64_t>(std::floor(x / kCellM)); }

maps::Box body_of(const maps::Box& box) {
  const double bottom = box.centre.z() - 0.5 * box.size_m.z();
  const double from = bottom + kBodyFrom * box.size_m.z() - kRayFloorM;
  const double to = bottom + kBodyTo * box.size_m.z();
  maps::Box body = box;
  body.centre.z() = 0.5 * (from + to);
  body.size_m.z() = to - from;
  return body;
}

}  // namespace

PlaceLooks::PlaceLooks(const std::vector<DetectedScan>& scans, const BoxRayCounter& count_rays)
    : scans_(scans), count_rays_(count_rays) {
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (scans[i].drive >= cells_.size()) cells_.resize(scans[i].drive + 1);
    const Eigen::Vector3d p = scans[i].T_map_lidar.translation();
    cells_[scans[i].drive][maps::plane_cell_key(cell_of(p.x()), cell_of(p.y()))].push_back(i);
  }
}

std::vector<PlaceLook> PlaceLooks::answers(const std::vector<PlaceQuestion>& questions) const {
  std::vector<std::size_t> order(questions.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return questions[a].scan < questions[b].scan;
  });
  std::vector<PlaceLook> looks(questions.size());
  for (const std::size_t i : order) looks[i] = look(questions[i]);
  return looks;
}

PlaceLook PlaceLooks::look(const PlaceQuestion& question) const {
  const maps::Box whole = to_lidar(*question.box, scans_[question.scan].T_map_lidar);
  maps::Box around = body_of(whole);
  maps::Box core = around;
  around.size_m.head<2>().array() += kGrowM;
  core.size_m.head<2>() =
      (core.size_m.head<2>().array() - kShrinkM).max(0.5 * core.size_m.head<2>().array()).matrix();
  PlaceLook out;
  out.on_body = count_rays_(question.scan, around).inside;
  const std::size_t through = count_rays_(question.scan, core).through;
  const std::size_t needed = is_small(whole.object_class) ? kMinThroughSmall : kMinThrough;
  if (through >= needed && through > kThroughOverInside * out.on_body) {
    out.state = PlaceState::kFree;
  } else if (out.on_body >= kMinOnBody && out.on_body > through) {
    out.state = PlaceState::kOccupied;
  }
  out.has_points = out.on_body > 0 || count_rays_(question.scan, whole).inside > 0;
  return out;
}

double PlaceLooks::distance_m(std::size_t scan, const Eigen::Vector2d& place) const {
  return (scans_[scan].T_map_lidar.translation().head<2>() - place).norm();
}

double PlaceLooks::travel_m(std::size_t scan_a, std::size_t scan_b) const {
  return (scans_[scan_a].T_map_lidar.translation() - scans_[scan_b].T_map_lidar.translation())
      .norm();
}

std::vector<std::size_t> PlaceLooks::scans_near(std::size_t drive, const Eigen::Vector2d& place,
                                                double reach_m) const {
  std::vector<std::size_t> near;
  if (drive >= cells_.size()) return near;
  const auto& cells = cells_[drive];
  for (std::int64_t x = cell_of(place.x() - reach_m); x <= cell_of(place.x() + reach_m); ++x) {
    for (std::int64_t y = cell_of(place.y() - reach_m); y <= cell_of(place.y() + reach_m); ++y) {
      const std::vector<std::size_t>* scans = cells.find(maps::plane_cell_key(x, y));
      if (scans == nullptr) continue;
      for (const std::size_t scan : *scans) {
        if (distance_m(scan, place) <= reach_m) near.push_back(scan);
      }
    }
  }
  std::sort(near.begin(), near.end());
  return near;
}

}  // namespace stillmap::mapping

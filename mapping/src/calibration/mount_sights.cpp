#include "calibration/followed_lidar.hpp"

#include "core/ordered_pipeline.hpp"
#include "odometry/direct/thinned_scan.hpp"

#include <stillmap/localization/local_map.hpp>
#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/frames.hpp>

#include <algorithm>

namespace stillmap::mapping {
namespace {

/// The reference's map reaches as far ahead of a scan [ns].
constexpr std::int64_t kAheadNs = 1'000'000'000;
/// Less of the map is too little to be found in.
constexpr std::size_t kLeastMapScans = 20;
/// Points of a scan that lie on the other lidar's map.
constexpr double kLeastOverlap = 0.4;

/// A scan that is added to the map, or is looked for in it.
struct MapEvent {
  std::int64_t at_ns = 0;
  bool is_query = false;
  std::size_t scan = 0;
};

std::vector<MapEvent> events_of(const SightSearch& search) {
  std::vector<MapEvent> events;
  const auto& map_stamps = search.reference.path.poses();
  for (std::size_t i = 0; i < map_stamps.size(); ++i)
    events.push_back({map_stamps[i].stamp_ns, false, i});
  const auto& stamps = search.lidar.path.poses();
  const std::size_t step = (stamps.size() + search.most_scans - 1) / search.most_scans;
  for (std::size_t i = 0; i < stamps.size(); i += std::max<std::size_t>(step, 1))
    events.push_back({stamps[i].stamp_ns + kAheadNs, true, i});
  std::ranges::stable_sort(events, {}, &MapEvent::at_ns);
  return events;
}

/// Evenly thinned points, moved to the stamp.
std::vector<Eigen::Vector3f> points_of(const FollowedLidar& lidar, const MapEvent& event) {
  const ThinnedScan scan = thinned(lidar.drive.read(event.scan));
  maps::PointCloud cloud = event.is_query ? scan.sparse : scan.dense;
  maps::deskew(cloud, lidar.twists[event.scan]);
  return std::move(cloud.positions);
}

}  // namespace

std::vector<MountSight> find_sights(const SightSearch& search, const CancelFlag& cancel) {
  const std::vector<MapEvent> events = events_of(search);
  localization::LocalMap map;
  std::size_t map_scans = 0, done = 0;
  std::vector<MountSight> sights;
  const auto look_for = [&](const MapEvent& event, const std::vector<Eigen::Vector3f>& points) {
    const std::int64_t stamp_ns = search.lidar.path.poses()[event.scan].stamp_ns;
    const auto T_odom_reference = search.reference.path.at(stamp_ns, 0.0);
    if (!T_odom_reference || map_scans < kLeastMapScans ||
        points.size() < localization::LocalAlignment::kMinMatched)
      return;
    Eigen::Isometry3d guess = maps::renormalized(*T_odom_reference * search.T_reference_lidar);
    if (search.widely) guess = map.searched(points, guess);
    const Eigen::Isometry3d found = map.refined(points, guess, search.off_m);
    const localization::LocalAlignment judged = map.judged(points, found);
    if (judged.matched < localization::LocalAlignment::kMinMatched ||
        judged.known_inlier_ratio < kLeastOverlap || !judged.degenerate_directions.empty())
      return;
    sights.push_back(
        {stamp_ns, T_odom_reference->inverse() * found, judged.covariance, judged.inlier_ratio});
  };
  process_in_order(
      events.size(), search.threads,
      [&](std::size_t i) {
        return points_of(events[i].is_query ? search.lidar : search.reference, events[i]);
      },
      [&](const std::vector<Eigen::Vector3f>& points) {
        const MapEvent& event = events[done++];
        if (search.progress) search.progress("match", done, events.size());
        if (event.is_query) return look_for(event, points);
        map.add(points, search.reference.path.poses()[event.scan].T_map_lidar);
        ++map_scans;
      },
      cancel);
  return sights;
}

}  // namespace stillmap::mapping

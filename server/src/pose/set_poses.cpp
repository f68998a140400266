#include "pose/set_poses.hpp"

#include "errors/api_error.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/geodesy.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace stillmap::server {
namespace {

using localization::AlignmentResult;
using localization::PoseStatus;
using localization::Prior;
using localization::Reason;
using localization::Tracker;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// A neighbour must know a place better by so much [m], before a vehicle goes on there. A vehicle
/// that stands on the border stays where it is: on the way back it is the other map that must.
constexpr double kMarginM = 10.0;
/// Beyond the box around its points a map has no places [m]: there the box tells enough.
constexpr double kOutsideM = 100.0;
/// A search that reaches no farther finds one place, whichever map it looks at [m].
constexpr double kOnePlaceM = 10.0;
/// How far a search around a prior without a covariance reaches [m]: see `Prior`.
constexpr double kPlainReachM = 30.0;
/// Places of two maps that are nearer than this are the same one.
constexpr double kSamePlaceM = 1.0;
constexpr double kSameTurnRad = 0.1;
/// Deviations of where one map of a set lies from where the other says it does [m, rad].
constexpr double kFramesOffM = 0.15;
constexpr double kFramesOffRad = 0.01;

Matrix6d frames_off() {
  Eigen::Matrix<double, 6, 1> sigma;
  sigma << Eigen::Vector3d::Constant(kFramesOffM), Eigen::Vector3d::Constant(kFramesOffRad);
  return sigma.cwiseAbs2().asDiagonal();
}

const localization::Aligner& aligner_of(const ServedVersion& map) {
  return *map.aligners->front().second;
}

double reach_m(const Prior& prior) {
  if (!prior.covariance) return kPlainReachM;
  return 3.0 * std::sqrt(prior.covariance->diagonal().head<3>().maxCoeff());
}

std::vector<SetCandidates::Each> everywhere(std::span<const SetMap> maps) {
  std::vector<SetCandidates::Each> each;
  for (const SetMap& map : maps) each.push_back({.in = &map, .prior = {}, .distance_m = 0.0});
  return each;
}

std::vector<SetCandidates::Each> around(std::span<const SetMap> maps, const PlaceInSet& place) {
  std::vector<SetCandidates::Each> each;
  for (const SetMap& map : maps) {
    SetCandidates::Each candidate{.in = &map, .prior = place.prior, .distance_m = 0.0};
    if (place.prior) {
      candidate.prior->T_map_lidar = map.T_set_map.inverse() * place.prior->T_map_lidar;
    } else {
      const auto& origin = map.map.package->manifest().geodetic_origin;
      if (!origin) continue;
      candidate.prior =
          prior_from(*place.gnss, *origin, map.map.seen_from->poses(*map.map.package));
    }
    candidate.distance_m = distance_m(map.map, candidate.prior->T_map_lidar.translation());
    each.push_back(std::move(candidate));
  }
  std::stable_sort(each.begin(), each.end(),
                   [](const auto& a, const auto& b) { return a.distance_m < b.distance_m; });
  return each;
}

bool has(const AlignmentResult& result, Reason reason) {
  return std::find(result.reasons.begin(), result.reasons.end(), reason) != result.reasons.end();
}

/// Whether a map shows what the scan does: no reason against it but that no second scan has agreed
/// yet, or that it shows it twice.
bool is_good(const AlignmentResult& result) {
  if (result.status == PoseStatus::kLost) return false;
  return has(result, Reason::kAmbiguous) ||
         std::all_of(result.reasons.begin(), result.reasons.end(),
                     [](Reason reason) { return reason == Reason::kUnconfirmed; });
}

/// By how much it may be used.
std::pair<int, double> rank(const AlignmentResult& result) {
  int order = 0;
  if (result.status == PoseStatus::kDegraded) order = is_good(result) ? 2 : 1;
  if (result.status == PoseStatus::kOk) order = 3;
  return {order, result.inlier_ratio};
}

bool is_one_place(const Eigen::Isometry3d& T_set_a, const Eigen::Isometry3d& T_set_b) {
  const Eigen::Isometry3d T_a_b = T_set_a.inverse() * T_set_b;
  return T_a_b.translation().norm() <= kSamePlaceM &&
         maps::rotation_angle_rad(T_a_b.linear()) <= kSameTurnRad;
}

/// Of a vehicle whose map the set has.
struct Neighbour {
  const SetMap* own = nullptr;
  const SetMap* nearest = nullptr;
  /// How much nearer to where it was driven than the own map [m].
  double nearer_m = 0.0;
};

Neighbour neighbour_of(const SetVehicle& vehicle, std::span<const SetMap> maps,
                       const Eigen::Isometry3d& T_map_lidar) {
  Neighbour found;
  for (const SetMap& each : maps)
    if (each.map.map == vehicle.map.map) found.own = &each;
  if (found.own == nullptr) return found;
  const double own_m = distance_m(vehicle.map, T_map_lidar.translation());
  const Eigen::Vector3d p_set = found.own->T_set_map * T_map_lidar.translation();
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const SetMap& each : maps) {
    if (&each == found.own) continue;
    const double its_m = distance_m(each.map, each.T_set_map.inverse() * p_set);
    if (its_m >= nearest_m) continue;
    nearest_m = its_m;
    found.nearest = &each;
  }
  found.nearer_m = own_m - nearest_m;
  return found;
}

/// Of a large set those that lie nearest to the map in which a vehicle was lost.
std::vector<SetMap> near(std::span<const SetMap> maps, const std::string& map) {
  std::vector<SetMap> sorted(maps.begin(), maps.end());
  const auto centre = [](const SetMap& each) -> Eigen::Vector3d {
    const maps::MapManifest& manifest = each.map.package->manifest();
    return each.T_set_map * (manifest.origin + manifest.extent.from_origin.center());
  };
  Eigen::Vector3d p_set = centre(sorted.front());
  for (const SetMap& each : sorted)
    if (each.map.map == map) p_set = centre(each);
  std::stable_sort(sorted.begin(), sorted.end(), [&](const SetMap& a, const SetMap& b) {
    return (centre(a) - p_set).squaredNorm() < (centre(b) - p_set).squaredNorm();
  });
  if (sorted.size() > kMostCandidates) sorted.resize(kMostCandidates);
  return sorted;
}

/// In the maps that it may be in, each with a tracker of its own.
SetTrackedPose find_vehicle(SetVehicle& vehicle, const SetCandidates& candidates,
                            const std::function<localization::TrackedPose(Tracker&)>& track) {
  std::vector<std::pair<Tracker, localization::TrackedPose>> tried;
  const FoundInSet found = search_in(candidates, [&](const SetCandidates::Each& each) {
    const ServedVersion& map = each.in->map;
    Tracker tracker =
        vehicle.tracker.continued_in(map.aligners->front().second, map.localization.tracker,
                                     Eigen::Isometry3d::Identity(), frames_off());
    if (each.prior) tracker.initialize(each.prior->T_map_lidar, each.prior->covariance.value());
    localization::TrackedPose pose = track(tracker);
    AlignmentResult result = pose.result;
    tried.emplace_back(std::move(tracker), std::move(pose));
    return result;
  });
  auto& [tracker, pose] = tried.at(found.candidate);
  const ServedVersion& map = candidates.maps[found.candidate].in->map;
  // One that began in the wrong of two maps would be confirmed there.
  const bool is_open =
      has(found.result, Reason::kAmbiguous) && !has(pose.result, Reason::kAmbiguous);
  const std::optional<PlaceInSet> begin = is_open ? vehicle.begin : std::nullopt;
  if (is_open) tracker = Tracker(map.aligners->front().second, map.localization.tracker);
  pose.result = found.result;
  vehicle = {.map = map,
             .tracker = std::move(tracker),
             .is_rolled_out = candidates.maps[found.candidate].in->is_rolled_out,
             .begin = begin};
  return {std::move(pose), {}};
}

}  // namespace

double distance_m(const ServedVersion& map, const Eigen::Vector3d& p_map) {
  const maps::MapManifest& manifest = map.package->manifest();
  const double outside_m =
      manifest.extent.from_origin.translated(manifest.origin).exteriorDistance(p_map);
  if (outside_m > kOutsideM) return outside_m;
  const double driven_m = map.seen_from->distance_m(*map.package, p_map);
  return std::isfinite(driven_m) ? driven_m : outside_m;
}

SetCandidates candidates_in(std::span<const SetMap> maps, const PlaceInSet& place) {
  SetCandidates found;
  if (place.prior || place.gnss) {
    found.maps = around(maps, place);
    if (found.maps.empty())
      throw field_error(ErrorCode::kNoGeodeticOrigin, "gnss", "maps without geodetic_origin",
                        "a prior in the set's frame, or maps with a place on the Earth (build "
                        "--geo-origin)");
    const double reach = reach_m(*found.maps.front().prior);
    const double most_m = std::max(reach, found.maps.front().distance_m) + kMarginM;
    std::erase_if(found.maps, [&](const auto& each) { return each.distance_m > most_m; });
    found.is_vague = reach > kOnePlaceM;
  } else {
    found.maps = everywhere(maps);
  }
  if (found.maps.size() > kMostCandidates)
    throw field_error(
        ErrorCode::kInvalidRequest, place.gnss ? "gnss" : "prior",
        fmt::format("{}, so that the scan may be in {} maps",
                    place.prior || place.gnss ? "a vague one" : "nothing", found.maps.size()),
        fmt::format("a place that leaves at most {} maps", kMostCandidates));
  return found;
}

FoundInSet search_in(const SetCandidates& candidates,
                     const std::function<AlignmentResult(const SetCandidates::Each&)>& align) {
  std::vector<AlignmentResult> results;
  std::size_t best = 0;
  for (const SetCandidates::Each& each : candidates.maps) {
    results.push_back(align(each));
    if (rank(results.back()) > rank(results[best])) best = results.size() - 1;
    if (!candidates.is_vague && results.back().status == PoseStatus::kOk) break;
  }
  FoundInSet found{.candidate = best, .result = results.at(best)};
  const auto T_set_lidar = [&](std::size_t i) {
    return candidates.maps[i].in->T_set_map * results[i].T_map_lidar;
  };
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (!is_good(results[i]) || is_one_place(T_set_lidar(best), T_set_lidar(i))) continue;
    if (found.result.status == PoseStatus::kOk) found.result.status = PoseStatus::kDegraded;
    found.result.protection = {};
    if (!has(found.result, Reason::kAmbiguous)) found.result.reasons.push_back(Reason::kAmbiguous);
  }
  return found;
}

SetTrackedPose track_in_set(SetVehicle& vehicle, std::span<const SetMap> maps,
                            std::int64_t stamp_ns, const localization::ThinScan& scan_lidar,
                            const std::optional<localization::OdometryStep>& odometry,
                            const std::function<void()>& require_wanted) {
  const auto track = [&](Tracker& tracker) {
    require_wanted();
    return tracker.track_thin(stamp_ns, scan_lidar, odometry);
  };
  const auto T_map_lidar = vehicle.tracker.believed_T_map_lidar();
  if (!maps.empty() && vehicle.begin)
    return find_vehicle(vehicle, candidates_in(maps, *vehicle.begin), track);
  if (!maps.empty() && !T_map_lidar) {
    const std::vector<SetMap> around = near(maps, vehicle.map.map);
    return find_vehicle(vehicle, candidates_in(around, {}), track);
  }
  Neighbour neighbour;
  if (T_map_lidar) neighbour = neighbour_of(vehicle, maps, *T_map_lidar);
  if (neighbour.nearest == nullptr || neighbour.nearer_m < -kMarginM)
    return {track(vehicle.tracker), {}};

  const ServedVersion& next = neighbour.nearest->map;
  Tracker there = vehicle.tracker.continued_in(
      next.aligners->front().second, next.localization.tracker,
      neighbour.nearest->T_set_map.inverse() * neighbour.own->T_set_map, frames_off());
  const auto go_on_there = [&](localization::TrackedPose pose) {
    std::string from = vehicle.map.map;
    vehicle = {.map = next,
               .tracker = std::move(there),
               .is_rolled_out = neighbour.nearest->is_rolled_out,
               .begin = {}};
    return SetTrackedPose{std::move(pose), std::move(from)};
  };
  std::optional<localization::TrackedPose> pose_there;
  if (neighbour.nearer_m > kMarginM) {
    pose_there = track(there);
    if (pose_there->result.status == PoseStatus::kOk) return go_on_there(*std::move(pose_there));
  }
  localization::TrackedPose here = track(vehicle.tracker);
  if (here.result.status == PoseStatus::kOk) return {std::move(here), {}};
  if (!pose_there) pose_there = track(there);
  if (rank(pose_there->result).first > rank(here.result).first &&
      (pose_there->result.status == PoseStatus::kOk || here.result.status == PoseStatus::kLost))
    return go_on_there(*std::move(pose_there));
  return {std::move(here), {}};
}

std::vector<SetMap> maps_like(std::span<const SetMap> maps, const ServedVersion& map) {
  const float own_vehicle_m = aligner_of(map).thin({}).own_vehicle_m;
  const bool has_origin = map.package->manifest().geodetic_origin.has_value();
  std::vector<SetMap> alike;
  for (const SetMap& each : maps)
    if (aligner_of(each.map).thin({}).own_vehicle_m == own_vehicle_m &&
        each.map.package->manifest().geodetic_origin.has_value() == has_origin)
      alike.push_back(each);
  return alike;
}

}  // namespace stillmap::server

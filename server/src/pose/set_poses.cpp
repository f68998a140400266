#include "pose/set_poses.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/trajectory.hpp>

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
/// A map that cannot be asked may be the one, unless another was driven so near to a place [m].
constexpr double kNearM = 50.0;
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

/// Whether it shows the scan about as well as the best map does, as places of one map are compared.
bool is_rival(const AlignmentResult& result, const AlignmentResult& best, double share) {
  if (result.status == PoseStatus::kLost) return false;
  return is_good(result) || (!has(result, Reason::kContradictsPrior) &&
                             result.inlier_ratio >= share * best.inlier_ratio);
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

const SetMap* member_of(const SetOfRequest& set, const std::string& map) {
  for (const SetMap& each : set.maps)
    if (each.map.map == map) return &each;
  return nullptr;
}

/// Of a vehicle whose map the set has.
struct Neighbour {
  const SetMap* own = nullptr;
  const SetMap* nearest = nullptr;
  /// How much nearer to where it was driven than the own map [m].
  double nearer_m = 0.0;
};

Neighbour neighbour_of(const SetVehicle& vehicle, const SetOfRequest& set,
                       const Eigen::Isometry3d& T_map_lidar) {
  Neighbour found{.own = member_of(set, vehicle.map.map)};
  if (found.own == nullptr) return found;
  const double own_m = distance_m(vehicle.map, T_map_lidar.translation());
  const Eigen::Vector3d p_set = found.own->T_set_map * T_map_lidar.translation();
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const SetMap& each : set.maps) {
    if (&each == found.own) continue;
    const double its_m = distance_m(each.map, each.T_set_map.inverse() * p_set);
    if (its_m >= nearest_m) continue;
    nearest_m = its_m;
    found.nearest = &each;
  }
  found.nearer_m = own_m - nearest_m;
  return found;
}

/// How far a vehicle may have come since its place was known [m].
double way_m(const SetVehicle& vehicle, std::int64_t stamp_ns) {
  constexpr double kMostMS = 50.0;
  const double since_s = vehicle.map.localization.tracker.max_coast_s +
                         maps::seconds_between(*vehicle.tracker.newest_ns(), stamp_ns);
  return kOutsideM + kMostMS * since_s;
}

/// The maps that a vehicle may be in which is not found in its own any more: that one first, and
/// of a large set those that lie nearest to it.
SetCandidates around_own(const SetOfRequest& set, const SetMap* own, const SetVehicle& vehicle,
                         std::int64_t stamp_ns) {
  if (set.loading) throw ApiError(*set.loading);
  SetCandidates near{.maps = everywhere(set.maps)};
  const auto newest_ns = vehicle.tracker.newest_ns();
  const auto T_map_lidar = vehicle.tracker.believed_T_map_lidar();
  // One that was followed up to the last scan is not far.
  if (own != nullptr && T_map_lidar && newest_ns &&
      vehicle.tracker.knows_place_at(*newest_ns + 1)) {
    const Eigen::Vector3d p_set = own->T_set_map * T_map_lidar->translation();
    std::erase_if(near.maps, [&](const SetCandidates::Each& each) {
      return each.in != own && distance_m(each.in->map, each.in->T_set_map.inverse() * p_set) >
                                   way_m(vehicle, stamp_ns);
    });
  }
  const auto centre = [](const SetMap& each) -> Eigen::Vector3d {
    const maps::MapManifest& manifest = each.map.package->manifest();
    return each.T_set_map * (manifest.origin + manifest.extent.from_origin.center());
  };
  const Eigen::Vector3d p_set = centre(own != nullptr ? *own : set.maps.front());
  for (SetCandidates::Each& each : near.maps)
    each.distance_m = each.in == own ? -1.0 : (centre(*each.in) - p_set).norm();
  std::ranges::stable_sort(near.maps, {}, &SetCandidates::Each::distance_m);
  if (near.maps.size() > kMostCandidates) near.maps.resize(kMostCandidates);
  return near;
}

/// In the maps that it may be in, each with a tracker of its own.
SetTrackedPose find_vehicle(SetVehicle& vehicle, const SetCandidates& candidates,
                            const std::function<Tracker(const SetCandidates::Each&)>& tracker_in,
                            const std::function<localization::TrackedPose(Tracker&)>& track) {
  std::vector<std::pair<Tracker, localization::TrackedPose>> tried;
  const FoundInSet found = search_in(candidates, [&](const SetCandidates::Each& each) {
    auto& [tracker, pose] = tried.emplace_back(tracker_in(each), localization::TrackedPose{});
    pose = track(tracker);
    return pose.result;
  });
  const bool is_lost = found.result.status == PoseStatus::kLost;
  // One that is in none of them stays where it was.
  const std::size_t chosen = is_lost ? 0 : found.candidate;
  auto& [tracker, pose] = tried.at(chosen);
  if (!is_lost) pose.result = found.result;
  // A tracker that keeps its place is followed in its map, and no other map is asked again. So it
  // keeps none unless one map alone has shown the scan.
  const bool shows_none =
      found.is_between_maps || (vehicle.begin && (is_lost || !is_good(found.result) ||
                                                  has(found.result, Reason::kAmbiguous)));
  if (candidates.maps.size() > 1 && shows_none) tracker.forget_place();
  const SetMap& in = *candidates.maps[chosen].in;
  // In its own map it stays in the version that it has.
  if (vehicle.begin || in.map.map != vehicle.map.map) {
    vehicle.map = in.map;
    vehicle.is_rolled_out = in.is_rolled_out;
  }
  vehicle.tracker = std::move(tracker);
  vehicle.begin.reset();
  return {.pose = std::move(pose), .handed_over_from = {}, .not_shown_by = {}};
}

/// @throws as `candidates_in`.
SetTrackedPose find_beginning(SetVehicle& vehicle, const SetOfRequest& set,
                              const std::function<localization::TrackedPose(Tracker&)>& track) {
  const auto tracker_in = [](const SetCandidates::Each& each) {
    const ServedVersion& map = each.in->map;
    Tracker tracker(map.aligners->front().second, map.localization.tracker);
    if (each.prior) tracker.initialize(each.prior->T_map_lidar, each.prior->covariance.value());
    return tracker;
  };
  return find_vehicle(vehicle, candidates_in(set, *vehicle.begin), tracker_in, track);
}

/// A vehicle that was lost, or that one scan has found and no other has confirmed.
SetTrackedPose find_again(SetVehicle& vehicle, const SetOfRequest& set, std::int64_t stamp_ns,
                          const std::function<localization::TrackedPose(Tracker&)>& track) {
  const SetMap* own = member_of(set, vehicle.map.map);
  const auto tracker_in = [&](const SetCandidates::Each& each) {
    if (each.in == own) return vehicle.tracker;
    const ServedVersion& map = each.in->map;
    Eigen::Isometry3d T_map_own = each.in->T_set_map.inverse();
    if (own != nullptr) T_map_own = T_map_own * own->T_set_map;
    Tracker tracker = vehicle.tracker.continued_in(
        map.aligners->front().second, map.localization.tracker, T_map_own, frames_off());
    if (own == nullptr) tracker.forget_place();
    return tracker;
  };
  return find_vehicle(vehicle, around_own(set, own, vehicle, stamp_ns), tracker_in, track);
}

/// Nothing where it cannot be asked: a vehicle in a sound map does not stop for that.
std::optional<localization::TrackedPose> tracked_beside(
    Tracker& tracker, const std::function<localization::TrackedPose(Tracker&)>& track) {
  try {
    return track(tracker);
  } catch (const maps::InputError&) {
    return std::nullopt;
  } catch (const maps::StorageError&) {
    return std::nullopt;
  }
}

}  // namespace

double distance_m(const ServedVersion& map, const Eigen::Vector3d& p_map) {
  const maps::MapManifest& manifest = map.package->manifest();
  const double outside_m =
      manifest.extent.from_origin.translated(manifest.origin).exteriorDistance(p_map);
  if (outside_m > kOutsideM) return outside_m;
  try {
    const double driven_m = map.seen_from->distance_m(*map.package, p_map);
    if (std::isfinite(driven_m)) return driven_m;
  } catch (const maps::InputError&) {
    // Its trajectories are damaged, which vehicles in other maps need not suffer for.
  } catch (const maps::StorageError&) {
    // As above.
  }
  return outside_m;
}

SetCandidates candidates_in(const SetOfRequest& set, const PlaceInSet& place) {
  SetCandidates found;
  const bool is_placed = place.prior || place.gnss;
  if (is_placed) {
    found.maps = around(set.maps, place);
    if (found.maps.empty())
      throw field_error(ErrorCode::kNoGeodeticOrigin, "gnss", "maps without geodetic_origin",
                        "a prior in the set's frame, or maps with a place on the Earth (build "
                        "--geo-origin)");
    const double nearest_m = found.maps.front().distance_m;
    const double reach = reach_m(*found.maps.front().prior);
    const double most_m = std::max(reach, nearest_m) + kMarginM;
    std::erase_if(found.maps, [&](const auto& each) { return each.distance_m > most_m; });
    found.is_vague = reach > kSamePlaceM;
    if (set.loading && (found.is_vague || nearest_m > kNearM)) throw ApiError(*set.loading);
    if (set.unusable && nearest_m > kNearM) throw ApiError(*set.unusable);
  } else {
    if (set.loading) throw ApiError(*set.loading);
    found.maps = everywhere(set.maps);
  }
  if (found.maps.size() > kMostCandidates)
    throw field_error(
        ErrorCode::kInvalidRequest,
        !is_placed   ? "set"
        : place.gnss ? "gnss"
                     : "prior",
        fmt::format("{}, so that the scan may be in {} maps",
                    is_placed ? "a vague place" : "no prior and no gnss", found.maps.size()),
        fmt::format("a place that leaves at most {} maps", kMostCandidates));
  return found;
}

FoundInSet search_in(const SetCandidates& candidates,
                     const std::function<AlignmentResult(const SetCandidates::Each&)>& align) {
  std::vector<AlignmentResult> results;
  std::size_t best = 0;
  for (const SetCandidates::Each& each : candidates.maps) {
    results.emplace_back();
    try {
      results.back() = align(each);
    } catch (const maps::InputError&) {
      // One that is damaged is left out, as one that cannot be loaded is.
      if (results.size() == 1) throw;
    } catch (const maps::StorageError&) {
      if (results.size() == 1) throw;
    }
    if (rank(results.back()) > rank(results[best])) best = results.size() - 1;
    if (!candidates.is_vague && results.back().status == PoseStatus::kOk) break;
  }
  FoundInSet found{.candidate = best, .result = results.at(best)};
  const double share = candidates.maps[best].in->map.localization.verdict.ambiguous_share;
  const auto T_set_lidar = [&](std::size_t i) {
    return candidates.maps[i].in->T_set_map * results[i].T_map_lidar;
  };
  if (found.result.status == PoseStatus::kLost) return found;
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (!is_rival(results[i], results[best], share)) continue;
    if (is_one_place(T_set_lidar(best), T_set_lidar(i))) continue;
    if (found.result.status == PoseStatus::kOk) found.result.status = PoseStatus::kDegraded;
    found.result.protection = {};
    found.is_between_maps = true;
    if (!has(found.result, Reason::kAmbiguous)) found.result.reasons.push_back(Reason::kAmbiguous);
  }
  return found;
}

SetTrackedPose track_in_set(SetVehicle& vehicle, const SetOfRequest& set, const ScanInSet& scan) {
  const auto track = [&](Tracker& tracker) {
    scan.require_wanted();
    localization::TrackedPose pose =
        tracker.track_thin(scan.stamp_ns, scan.scan_lidar, scan.odometry);
    scan.matched(pose);
    return pose;
  };
  const auto in_own = [&]() -> SetTrackedPose {
    return {.pose = track(vehicle.tracker), .handed_over_from = {}, .not_shown_by = {}};
  };
  if (set.maps.empty()) return in_own();
  if (vehicle.begin) return find_beginning(vehicle, set, track);
  if (!vehicle.tracker.knows_place_at(scan.stamp_ns, scan.odometry))
    return find_again(vehicle, set, scan.stamp_ns, track);
  Neighbour neighbour;
  if (const auto T_map_lidar = vehicle.tracker.believed_T_map_lidar())
    neighbour = neighbour_of(vehicle, set, *T_map_lidar);
  // On the way back it would be the other one's turn: there and back with each bad scan is none.
  if (neighbour.nearest == nullptr || neighbour.nearer_m < 0.0) return in_own();

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
    return SetTrackedPose{
        .pose = std::move(pose), .handed_over_from = std::move(from), .not_shown_by = {}};
  };
  const bool is_nearer = neighbour.nearer_m > kMarginM;
  std::optional<localization::TrackedPose> pose_there;
  if (is_nearer) pose_there = tracked_beside(there, track);
  if (pose_there && pose_there->result.status == PoseStatus::kOk)
    return go_on_there(*std::move(pose_there));
  Tracker own = vehicle.tracker;
  localization::TrackedPose here = track(own);
  if (here.result.status != PoseStatus::kOk) {
    if (!is_nearer) pose_there = tracked_beside(there, track);
    if (pose_there && rank(pose_there->result).first > rank(here.result).first &&
        (pose_there->result.status == PoseStatus::kOk || here.result.status == PoseStatus::kLost))
      return go_on_there(*std::move(pose_there));
  }
  vehicle.tracker = std::move(own);
  return {.pose = std::move(here),
          .handed_over_from = {},
          .not_shown_by = is_nearer ? next.map : std::string()};
}

SetOfRequest maps_like(SetOfRequest set, const ServedVersion& map) {
  const float own_vehicle_m = aligner_of(map).thin({}).own_vehicle_m;
  std::erase_if(set.maps, [&](const SetMap& each) {
    return aligner_of(each.map).thin({}).own_vehicle_m != own_vehicle_m;
  });
  return set;
}

}  // namespace stillmap::server

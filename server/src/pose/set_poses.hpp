#pragma once

#include "catalog/map_catalog.hpp"
#include "pose/gnss_prior.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/tracker.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

/// Poses in a set of maps: which map is asked, and when a vehicle goes on in the next one.
namespace stillmap::server {

/// A map of a set, ready for poses.
struct SetMap {
  ServedVersion map;
  Eigen::Isometry3d T_set_map = Eigen::Isometry3d::Identity();
  /// Whether a roll-out chose the version.
  bool is_rolled_out = false;
};

/// Where a request says that the lidar is: a prior in the frame of the set, a satellite fix, or
/// nothing.
struct PlaceInSet {
  std::optional<localization::Prior> prior;
  std::optional<GnssFix> gnss;
};

/// How far a place is from where a map was driven [m]: there it shows most. Of a map that says
/// nothing of that, from the box around its points.
[[nodiscard]] double distance_m(const ServedVersion& map, const Eigen::Vector3d& p_map);

/// The maps that a scan is looked for in, the best one first.
struct SetCandidates {
  struct Each {
    const SetMap* in = nullptr;
    /// In its frame.
    std::optional<localization::Prior> prior;
    double distance_m = 0.0;
  };
  std::vector<Each> maps;
  /// Whether the place is so vague that another map may show one that looks alike.
  bool is_vague = true;
};
/// Most of them.
inline constexpr std::size_t kMostCandidates = 16;
/// @param maps  at least one; outlives the result.
/// @throws ApiError kInvalidRequest when there are more than `kMostCandidates`; kNoGeodeticOrigin
/// for a fix where no map has an origin.
[[nodiscard]] SetCandidates candidates_in(std::span<const SetMap> maps, const PlaceInSet& place);

/// What a search found, and where.
struct FoundInSet {
  std::size_t candidate = 0;
  localization::AlignmentResult result;
};
/// Looks for a scan in one candidate after the other, of which the first good answer counts; for a
/// vague place in all of them. Then an answer is `ambiguous`, and not `ok`, when another map has a
/// good one at another place.
/// @param align  the scan in one candidate.
[[nodiscard]] FoundInSet search_in(
    const SetCandidates& candidates,
    const std::function<localization::AlignmentResult(const SetCandidates::Each&)>& align);

/// A vehicle that is followed through the maps of a set, or through one map.
struct SetVehicle {
  ServedVersion map;
  localization::Tracker tracker;
  bool is_rolled_out = false;
  /// Where it begins, until its first scan is answered.
  std::optional<PlaceInSet> begin;
};
struct SetTrackedPose {
  localization::TrackedPose pose;
  /// Map in which it was before, if that was another one and the vehicle was followed there.
  std::string handed_over_from;
};
/// Answers a scan as `Tracker::track_thin`. Where a neighbour knows the vehicle's place better by a
/// margin, it is matched there, and the vehicle goes on there if that is `ok`; so it does where its
/// own map gives no `ok` and a neighbour does. A vehicle whose place is not known is looked for in
/// all maps.
/// @param maps  of the set; empty: the vehicle stays in its map. Those that thin scans otherwise
/// than the vehicle's map are left out.
/// @param require_wanted  called before each match; may throw.
/// @throws as `Tracker::track_thin` and `candidates_in`.
[[nodiscard]] SetTrackedPose track_in_set(SetVehicle& vehicle, std::span<const SetMap> maps,
                                          std::int64_t stamp_ns,
                                          const localization::ThinScan& scan_lidar,
                                          const std::optional<localization::OdometryStep>& odometry,
                                          const std::function<void()>& require_wanted);

/// Those that take scans which were thinned for this map, and tell as much of the Earth.
[[nodiscard]] std::vector<SetMap> maps_like(std::span<const SetMap> maps, const ServedVersion& map);

}  // namespace stillmap::server

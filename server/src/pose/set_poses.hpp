#pragma once

#include "catalog/map_catalog.hpp"
#include "errors/api_error.hpp"
#include "pose/gnss_prior.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/tracker.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
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

/// A set as a request may use it.
struct SetOfRequest {
  /// Empty: all maps with a place on the Earth.
  std::string name;
  /// The maps that can be asked now.
  std::vector<SetMap> maps;
  /// Why others cannot, where there are some: one is being loaded; one is broken, or has no active
  /// version.
  std::optional<ApiError> loading, unusable;
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
/// @param set  of at least one map; outlives the result.
/// @throws ApiError kInvalidRequest when there are more than `kMostCandidates`; kNoGeodeticOrigin
/// for a fix where no map has an origin; `loading` and `unusable` of the set where the scan may be
/// in such a map.
[[nodiscard]] SetCandidates candidates_in(const SetOfRequest& set, const PlaceInSet& place);

/// What a search found, and where.
struct FoundInSet {
  std::size_t candidate = 0;
  localization::AlignmentResult result;
  /// `ambiguous` since two maps show the scan at two places.
  bool is_between_maps = false;
};
/// Looks for a scan in one candidate after the other, of which the first `ok` counts; for a vague
/// place in all of them. Then an answer is `ambiguous`, and not `ok`, when another map shows the
/// scan at another place, about as well.
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
/// One scan of it.
struct ScanInSet {
  std::int64_t stamp_ns = 0;
  const localization::ThinScan& scan_lidar;
  const std::optional<localization::OdometryStep>& odometry;
  /// Called before each match; may throw.
  std::function<void()> require_wanted;
  /// Called after each match.
  std::function<void(const localization::TrackedPose&)> matched;
};
struct SetTrackedPose {
  localization::TrackedPose pose;
  /// Map in which it was before, if that was another one and the vehicle was followed there.
  std::string handed_over_from;
  /// Map that was driven nearer to the vehicle than its own, and shows the scan less well.
  std::string not_shown_by;
};
/// Answers a scan as `Tracker::track_thin`. Where a neighbour knows the vehicle's place better by a
/// margin, it is matched there, and the vehicle goes on there if that is `ok`; so it does where its
/// own map gives no `ok` and a neighbour that knows the place as well does. A vehicle whose place
/// is not known is looked for in all maps, until one of them alone shows two scans in a row. If
/// this throws, the vehicle is as it was.
/// @param set  without maps: the vehicle stays in its map. Those that thin scans otherwise than the
/// vehicle's map are left out.
/// @throws as `Tracker::track_thin` and `candidates_in`.
[[nodiscard]] SetTrackedPose track_in_set(SetVehicle& vehicle, const SetOfRequest& set,
                                          const ScanInSet& scan);

/// Without the maps that do not take scans which were thinned for this one.
[[nodiscard]] SetOfRequest maps_like(SetOfRequest set, const ServedVersion& map);

}  // namespace stillmap::server

#pragma once

#include <stillmap/mapping/rebuild.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// A drive with scans to ask for; its poses are in the new map's frame.
struct HeldBackDrive {
  maps::Drive drive;
  /// Of these scans.
  std::vector<std::size_t> scans;
};

/// The drive to judge by: its poses shifted in time as those of the map's drives are, in the frame
/// that these are said to be in. @throws as `maps::Drive::open`.
[[nodiscard]] maps::Drive held_back_drive(const RebuildOptions& options);

/// Refuses, before anything is built, a drive to hold back whose poses cannot be compared with the
/// map's.
/// @throws maps::InputError naming it.
void require_comparable(const RebuildOptions& options);

/// The scans to ask for, at most `kMostHeldBackScans`: of the drive to hold back, as far as it is
/// within some metres of where the map was made from; else those that the build left out.
///
/// Poses of left out scans are the drive's own where these are what the map was made from, moved as
/// the map's are; where poses were estimated they are taken between those of the scans before and
/// behind.
/// @param map  that the rebuild made.
/// @throws maps::InputError.
[[nodiscard]] std::vector<HeldBackDrive> held_back_drives(const RebuildOptions& options,
                                                          const maps::MapPackage& map);

/// The motion between two maps of the same poses: takes points of `from` to the frame of `to`.
/// @throws maps::InputError where a package lists no poses.
[[nodiscard]] Eigen::Isometry3d T_to_from(const maps::MapPackage& to, const maps::MapPackage& from);

/// Looks for the scans in a map.
/// @param T_this_map  takes points of the frame of the drives' poses to this map's.
/// @throws as `evaluate_localization`.
[[nodiscard]] HeldBackAnswers ask_for(const std::vector<HeldBackDrive>& drives,
                                      const maps::MapPackage& map,
                                      const Eigen::Isometry3d& T_this_map, int threads,
                                      const ProgressCallback& progress, const CancelFlag& cancel);

[[nodiscard]] std::string text_of(const HeldBackAnswers& answers);
/// @throws std::invalid_argument for another text.
[[nodiscard]] HeldBackAnswers answers_from(const std::string& text);

}  // namespace stillmap::mapping

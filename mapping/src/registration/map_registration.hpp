#pragma once

#include "drives/drive_set.hpp"
#include "registration/build_frame.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Drives that are to stand in a map's frame.
struct DrivesToRegister {
  /// With poses in one frame.
  const std::vector<maps::Drive>& drives;
  /// One a scan of each drive, or none. Hidden scans are not looked for.
  const std::vector<std::vector<ScanNote>>& notes;
  /// `given`, or the method that made the poses.
  const std::string& odometry;
};

/// Drives whose poses stand in a map's frame, and what else of it a new version takes over.
struct RegisteredDrives {
  std::vector<maps::Drive> drives;
  /// With `follows_map`: of each drive, the scans whose poses are known by the map.
  std::vector<std::vector<bool>> known_by_map;
  BuildFrame frame;
};

/// Brings the poses of a build into the frame of a map: some scans are localized in it, and one
/// motion is fitted to where they were found.
///
/// First, 48 scans spread over the selected ones are looked for: around their own poses where these
/// claim to be in the map's frame (given poses and a map that both have a geodetic origin, or both
/// have none), and where that finds nothing in common, or they do not claim it, everywhere. What
/// more than half of those found agree on (3 m, 3 deg) is then measured with up to 96 scans, at
/// least 1 m from each other, that lie where the map was driven; only answers `ok` count, each by
/// its covariance (`fit_frames`). Given poses that the motion moves by no more than 5 cm and 0.1
/// deg, any of them, are kept as they are, and the motion is only told.
/// @throws maps::InputError naming the map where fewer than 8 scans that span 10 m, or less than
/// three quarters of those found, agree with one motion within 0.3 m and 1 deg; as
/// `MapPackage::open`; Cancelled.
/// @note Same input, same bits for any number of threads. May write the map's index.
[[nodiscard]] RegisteredDrives registered_to(const std::filesystem::path& map,
                                             const DrivesToRegister& asked,
                                             const MapBuildOptions& options,
                                             const ProgressCallback& progress,
                                             const CancelFlag& cancel);

}  // namespace stillmap::mapping

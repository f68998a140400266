#pragma once

#include <stillmap/localization/thin_scan.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace stillmap::localization {

/// A scan as it is matched: the points of `thin_points`, or all of them for a method that thins in
/// its own way.
struct ThinScan {
  /// In the lidar frame, finite; with times where the scan has them.
  maps::PointCloud points_lidar;
  /// So many, from the first on, are matched. The others only tell where the ground is.
  std::size_t matched = 0;
  /// Range below which points were taken for the vehicle's own [m]: must be the aligner's.
  float own_vehicle_m = static_cast<float>(kOwnVehicleM);
};

/// A scan that a vehicle has thinned.
struct SentScan {
  ThinScan scan;
  /// Of the whole scan.
  std::size_t points = 0;
  std::size_t no_returns = 0;
};
/// Reads what `encode_thin_scan` writes; localization/thin_scan.md tells the layout.
/// @param name  for messages. @throws maps::InputError for everything that is wrong with it.
[[nodiscard]] SentScan decode_thin_scan(std::span<const std::byte> bytes, const std::string& name);

/// A view of a cloud, which must outlive it.
[[nodiscard]] ScanView view_of(const maps::PointCloud& scan_lidar);
[[nodiscard]] ScanView view_of(std::span<const Eigen::Vector3f> positions);

/// All points of a scan but no returns; all of them are matched.
[[nodiscard]] ThinScan whole_scan(const ScanView& scan_lidar);

/// The points of a scan that `thin` names.
[[nodiscard]] ThinScan picked(const ScanView& scan_lidar, const ThinPoints& thin);

/// As `one_point_a_cell` of a view.
[[nodiscard]] std::vector<std::size_t> one_point_a_cell(std::span<const Eigen::Vector3f> positions,
                                                        float cell_m, Lone lone = Lone::kKept,
                                                        double own_vehicle_m = kOwnVehicleM);

}  // namespace stillmap::localization

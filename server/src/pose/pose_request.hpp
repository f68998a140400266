#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/thinning.hpp>
#include <stillmap/localization/tracker.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/server/server_options.hpp>

#include "pose/gnss_prior.hpp"

#include <Eigen/Geometry>

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace stillmap::server {

/// Longest part `request` of one query [bytes]. 500 boxes of 7 numbers with 17 digits take some 120
/// KiB, and twice that when written over several lines; the rest of a query takes some 4 KiB. It is
/// read before the query waits for a worker, so many may be read at one time.
inline constexpr std::size_t kMostQueryJson = std::size_t{256} << 10U;

/// What a request with a scan is for, and so which parameters it may have.
enum class ScanPurpose {
  kQuery,      ///< a pose query of its own
  kBatchItem,  ///< one of several, which share a deadline
  kSession,    ///< the next scan of a session
  kSealed,     ///< the same of a sealed one, or its first scan, which may have a prior
  kSetQuery,   ///< as kQuery, in a set of maps, which the query may name
  kSetSealed,  ///< as kSealed, in a set of maps
};

/// Everything a pose request says besides the scan.
struct PoseParameters {
  /// None: the whole map is searched.
  std::optional<localization::Prior> prior;
  /// In place of a prior.
  std::optional<GnssFix> gnss;
  std::optional<Eigen::Isometry3d> T_base_lidar;
  /// Objects that may move, found by the caller: points inside are left out of the match.
  std::vector<maps::Box> movable;
  std::optional<std::int64_t> stamp_ns;
  /// Empty = the map's default.
  std::string method;
  std::optional<std::chrono::milliseconds> deadline;
  /// Of a session's scan.
  std::optional<localization::OdometryStep> odometry;
  /// Of raw scans.
  maps::ScanFormat raw_format = maps::ScanFormat::kBinXyzi;
};

/// A scan as it comes: points, raw points in the request's body, or what the vehicle has thinned.
using ScanOfRequest =
    std::variant<maps::PointCloud, localization::ScanView, localization::SentScan>;

struct PoseRequest {
  PoseParameters parameters;
  ScanOfRequest scan_lidar;
  /// Points of the scan that say that nothing came back.
  std::size_t no_returns = 0;
};

}  // namespace stillmap::server

#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/tracker.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/server/server_options.hpp>

#include "http/http_message.hpp"
#include "pose/gnss_prior.hpp"

#include <Eigen/Geometry>

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
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

struct PoseRequest {
  PoseParameters parameters;
  maps::PointCloud scan_lidar;
};

/// A pose request that has been read as far as costs little; decoding the scan is work that waits
/// for a worker.
struct ScanInBody {
  enum class Kind { kRaw, kPcd, kJson };
  Kind kind = Kind::kRaw;
  /// Lies in the request's body. Of kJson all of it, parameters included.
  std::string_view bytes;
  /// Not read yet of kJson.
  PoseParameters parameters;
};

/// Finds the scan in a request of any of its four content types.
///  - `application/octet-stream`, `application/vnd.pcd`: the body is the scan, the parameters are
///  the query;
///  - `application/json`: both in one object; not for sessions, whose stamps are asked for first;
///  - `multipart/form-data`: parts `request` (JSON) and `scan`.
/// @param request  outlives the result.
/// @throws ApiError for everything that is wrong with it.
[[nodiscard]] ScanInBody find_scan(const HttpRequest& request, const ServerOptions& options,
                                   ScanPurpose purpose);

/// @param require_wanted  called now and then, while a long JSON text is read.
/// @throws ApiError for what is no scan, or too small or large a one; what `require_wanted` throws.
[[nodiscard]] PoseRequest decode_scan(ScanInBody&& from, const ServerOptions& options,
                                      std::function<void()> require_wanted = {});

/// Raw or PCD bytes of a multipart part. @throws ApiError kUnsupportedMediaType.
[[nodiscard]] ScanInBody::Kind scan_kind_of(const std::string& part, const std::string& type);

}  // namespace stillmap::server

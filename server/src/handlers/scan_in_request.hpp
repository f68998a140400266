#pragma once

#include "http/http_message.hpp"
#include "pose/pose_request.hpp"

#include <functional>
#include <string>
#include <string_view>

namespace stillmap::server {

/// A pose request that has been read as far as costs little; decoding the scan is work that waits
/// for a worker.
struct ScanInBody {
  enum class Kind { kRaw, kPcd, kThin, kJson };
  Kind kind = Kind::kRaw;
  /// Lies in the request's body. Of kJson all of it, parameters included.
  std::string_view bytes;
  /// Not read yet of kJson.
  PoseParameters parameters;
};

/// Finds the scan in a request of any of its five content types.
///  - `application/octet-stream`, `application/vnd.pcd`, `application/vnd.stillmap.scan`: the body
///  is the scan, the parameters are the query;
///  - `application/json`: both in one object; not for sessions, whose stamps are asked for first;
///  - `multipart/form-data`: parts `request` (JSON) and `scan`.
/// @param request  outlives the result.
/// @throws ApiError for everything that is wrong with it.
[[nodiscard]] ScanInBody find_scan(const HttpRequest& request, const ServerOptions& options,
                                   ScanPurpose purpose);

/// A raw scan stays in the request's body, which outlives the result.
/// @param require_wanted  called now and then, while a long JSON text is read.
/// @throws ApiError for what is no scan, or too small or large a one; what `require_wanted` throws.
[[nodiscard]] PoseRequest decode_scan(ScanInBody&& from, const ServerOptions& options,
                                      std::function<void()> require_wanted = {});

/// Raw, PCD or thinned bytes of a multipart part. @throws ApiError kUnsupportedMediaType.
[[nodiscard]] ScanInBody::Kind scan_kind_of(const std::string& part, const std::string& type);

}  // namespace stillmap::server

#include "handlers/scan_in_request.hpp"

#include "bodies/pose_request_json.hpp"
#include "errors/api_error.hpp"
#include "handlers/flat_parameters.hpp"
#include "http/header_text.hpp"
#include "http/multipart.hpp"
#include "pose/pose_checks.hpp"

#include <fmt/format.h>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/scan_file.hpp>

#include <span>
#include <string_view>

namespace stillmap::server {
namespace {

constexpr std::string_view kRaw = "application/octet-stream";
constexpr std::string_view kPcd = "application/vnd.pcd";
constexpr std::string_view kThin = "application/vnd.stillmap.scan";

/// What `read` gives. @throws ApiError for what it refuses.
template <typename Read>
auto decoded(const Read& read) {
  try {
    return read();
  } catch (const maps::InputError& error) {
    throw ApiError(ErrorCode::kInvalidScan, error.what());
  }
}

maps::DecodedScan decode(std::string_view bytes, maps::ScanFormat format,
                         const ServerOptions& options) {
  return decoded([&] {
    return maps::decode_scan(std::as_bytes(std::span(bytes)), format, "scan",
                             options.max_scan_points);
  });
}

localization::ScanView view_raw(std::string_view bytes, maps::ScanFormat format,
                                const ServerOptions& options) {
  const std::size_t stride = maps::raw_point_bytes(format);
  const std::size_t points = bytes.size() / stride;
  if (points > options.max_scan_points) {
    throw field_error(ErrorCode::kPayloadTooLarge, "scan", fmt::format("{} points", points),
                      fmt::format("at most {}", options.max_scan_points));
  }
  // No whole number of points: the reader of files says what it may be.
  if (bytes.size() % stride != 0) static_cast<void>(decode(bytes, format, options));
  localization::ScanView view{.xyz = bytes.data(), .xyz_stride_bytes = stride, .size = points};
  if (format == maps::ScanFormat::kBinXyzit) {
    view.time_s = bytes.data() + 4 * sizeof(float);
    view.time_stride_bytes = stride;
  }
  return view;
}

void read_scan(const ScanInBody& from, const ServerOptions& options, PoseRequest& request) {
  const std::string_view bytes = from.bytes;
  if (from.kind == ScanInBody::Kind::kThin) {
    request.scan_lidar = decoded(
        [&] { return localization::decode_thin_scan(std::as_bytes(std::span(bytes)), "scan"); });
  } else if (from.kind == ScanInBody::Kind::kPcd) {
    maps::DecodedScan scan = decode(bytes, maps::ScanFormat::kPcd, options);
    request.no_returns = scan.dropped.non_finite + scan.dropped.zero_range;
    request.scan_lidar = std::move(scan.cloud);
  } else {
    request.scan_lidar = view_raw(bytes, from.parameters.raw_format, options);
  }
}

ScanInBody find_in_multipart(const HttpRequest& request, const ServerOptions& options,
                             ScanPurpose purpose) {
  const MultipartPart* text = nullptr;
  const MultipartPart* scan = nullptr;
  const std::vector<MultipartPart> parts =
      split_multipart(request.header("content-type"), request.body);
  for (const MultipartPart& part : parts) {
    const MultipartPart** place = part.name == "request" ? &text
                                  : part.name == "scan"  ? &scan
                                                         : nullptr;
    if (place == nullptr) {
      throw field_error(ErrorCode::kUnknownParameter, "multipart body", "part '" + part.name + "'",
                        "parts 'request' and 'scan'");
    }
    if (*place != nullptr)
      throw field_error(ErrorCode::kInvalidRequest, part.name, "it twice", "it once");
    *place = &part;
  }
  if (scan == nullptr) throw field_error(ErrorCode::kInvalidRequest, "scan", "no such part", "one");
  if (text != nullptr && text->content.size() > kMostQueryJson) {
    throw field_error(ErrorCode::kPayloadTooLarge, "request",
                      fmt::format("{} bytes", text->content.size()),
                      fmt::format("at most {}", kMostQueryJson));
  }
  ScanInBody found{
      .kind = scan_kind_of("scan", scan->content_type), .bytes = scan->content, .parameters = {}};
  const JsonScan beside =
      found.kind == ScanInBody::Kind::kRaw ? JsonScan::kRawBeside : JsonScan::kPcdBeside;
  found.parameters =
      read_pose_request_json(text == nullptr ? std::string_view("{}") : text->content, beside,
                             purpose, options)
          .parameters;
  return found;
}

void refuse_query(const HttpRequest& request, ScanPurpose purpose) {
  constexpr const char* kWhy = "with this content type the parameters stand in the JSON";
  if (has_set(purpose)) {
    for (const auto& [name, value] : request.query)
      if (name != kVehicleParameter && name != kSetParameter)
        throw field_error(
            ErrorCode::kUnknownParameter, "query", "'" + name + "'",
            fmt::format("'{}' and '{}' alone: {}", kVehicleParameter, kSetParameter, kWhy));
    return;
  }
  if (purpose == ScanPurpose::kQuery || purpose == ScanPurpose::kSealed)
    return require_vehicle_alone(request.query,
                                 fmt::format("'{}' alone: {}", kVehicleParameter, kWhy));
  if (request.query.empty()) return;
  throw field_error(ErrorCode::kUnknownParameter, "query", "'" + request.query.front().first + "'",
                    fmt::format("no query: {}", kWhy));
}

}  // namespace

ScanInBody::Kind scan_kind_of(const std::string& part, const std::string& type) {
  if (type.empty() || type == kRaw) return ScanInBody::Kind::kRaw;
  if (type == kPcd) return ScanInBody::Kind::kPcd;
  if (type == kThin) return ScanInBody::Kind::kThin;
  throw field_error(ErrorCode::kUnsupportedMediaType, part, "'" + type + "'",
                    fmt::format("{}, {} or {}", kRaw, kPcd, kThin));
}

ScanInBody find_scan(const HttpRequest& request, const ServerOptions& options,
                     ScanPurpose purpose) {
  const std::string type = media_type(request.header("content-type"));
  if (type == kRaw || type == kPcd || type == kThin) {
    return {.kind = scan_kind_of("Content-Type", type),
            .bytes = request.body,
            .parameters = read_flat_parameters(request.query, type == kRaw, purpose)};
  }
  const bool is_query = purpose == ScanPurpose::kQuery || purpose == ScanPurpose::kSetQuery;
  if (type == "application/json" && is_query) {
    refuse_query(request, purpose);
    return {.kind = ScanInBody::Kind::kJson, .bytes = request.body, .parameters = {}};
  }
  if (type == "multipart/form-data") {
    refuse_query(request, purpose);
    return find_in_multipart(request, options, purpose);
  }
  throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Type", "'" + type + "'",
                    fmt::format("{}, {}, {}{} or multipart/form-data", kRaw, kPcd, kThin,
                                is_query ? ", application/json" : ""));
}

PoseRequest decode_scan(ScanInBody&& from, const ServerOptions& options,
                        std::function<void()> require_wanted) {
  PoseRequest request;
  if (from.kind == ScanInBody::Kind::kJson) {
    JsonPoseRequest json = read_pose_request_json(
        from.bytes, JsonScan::kInside, ScanPurpose::kQuery, options, std::move(require_wanted));
    request.parameters = std::move(json.parameters);
    request.scan_lidar = std::move(json.scan_lidar);
  } else {
    read_scan(from, options, request);
    request.parameters = std::move(from.parameters);
  }
  check_scan(request, options);
  return request;
}

}  // namespace stillmap::server

#include "pose_request.hpp"

#include "api_error.hpp"
#include "flat_parameters.hpp"
#include "header_text.hpp"
#include "json/pose_request_json.hpp"
#include "multipart.hpp"
#include "pose_checks.hpp"

#include <fmt/format.h>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/scan_file.hpp>

#include <span>
#include <string_view>

namespace stillmap::server {
namespace {

constexpr std::string_view kRaw = "application/octet-stream";
constexpr std::string_view kPcd = "application/vnd.pcd";

maps::PointCloud decode(std::string_view bytes, maps::ScanFormat format,
                        const ServerOptions& options) {
  maps::DecodedScan decoded;
  try {
    decoded =
        maps::decode_scan(std::as_bytes(std::span(bytes)), format, "scan", options.max_scan_points);
  } catch (const maps::InputError& error) {
    throw ApiError(ErrorCode::kInvalidScan, error.what());
  }
  if (decoded.dropped.non_finite > 0) {
    throw field_error(ErrorCode::kInvalidPoints, "scan",
                      fmt::format("{} points that are not finite", decoded.dropped.non_finite),
                      "finite coordinates");
  }
  return std::move(decoded.cloud);
}

maps::PointCloud decode_raw(std::string_view bytes, bool has_intensity,
                            const ServerOptions& options) {
  const std::size_t stride = has_intensity ? 16 : 12;
  if (bytes.size() / stride > options.max_scan_points) {
    throw field_error(ErrorCode::kPayloadTooLarge, "scan",
                      fmt::format("{} points", bytes.size() / stride),
                      fmt::format("at most {}", options.max_scan_points));
  }
  return decode(bytes, has_intensity ? maps::ScanFormat::kBinXyzi : maps::ScanFormat::kBinXyz,
                options);
}

PoseRequest read_json_body(const HttpRequest& request, const ServerOptions& options) {
  JsonPoseRequest json = read_pose_request_json(request.body, JsonScan::kInside, options);
  return {std::move(json.parameters), std::move(json.scan_lidar)};
}

PoseRequest read_multipart(const HttpRequest& request, const ServerOptions& options) {
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
  const std::string type = scan->content_type.empty() ? std::string(kRaw) : scan->content_type;
  if (type != kRaw && type != kPcd) {
    throw field_error(ErrorCode::kUnsupportedMediaType, "scan", "'" + type + "'",
                      fmt::format("{} or {}", kRaw, kPcd));
  }
  JsonPoseRequest json =
      read_pose_request_json(text == nullptr ? std::string_view("{}") : text->content,
                             type == kPcd ? JsonScan::kPcdBeside : JsonScan::kRawBeside, options);
  maps::PointCloud cloud = type == kPcd
                               ? decode(scan->content, maps::ScanFormat::kPcd, options)
                               : decode_raw(scan->content, json.parameters.has_intensity, options);
  return {std::move(json.parameters), std::move(cloud)};
}

void refuse_query(const HttpRequest& request) {
  if (request.query.empty()) return;
  throw field_error(ErrorCode::kUnknownParameter, "query", "'" + request.query.front().first + "'",
                    "no query: with this content type the parameters stand in the JSON");
}

PoseRequest read_body(const HttpRequest& request, const ServerOptions& options) {
  const std::string type = media_type(request.header("content-type"));
  if (type == kRaw || type == kPcd) {
    PoseParameters parameters = read_flat_parameters(request.query, type == kRaw);
    maps::PointCloud cloud = type == kRaw
                                 ? decode_raw(request.body, parameters.has_intensity, options)
                                 : decode(request.body, maps::ScanFormat::kPcd, options);
    return {std::move(parameters), std::move(cloud)};
  }
  if (type == "application/json") {
    refuse_query(request);
    return read_json_body(request, options);
  }
  if (type == "multipart/form-data") {
    refuse_query(request);
    return read_multipart(request, options);
  }
  throw field_error(ErrorCode::kUnsupportedMediaType, "Content-Type", "'" + type + "'",
                    fmt::format("{}, {}, application/json or multipart/form-data", kRaw, kPcd));
}

}  // namespace

PoseRequest read_pose_request(const HttpRequest& request, const ServerOptions& options) {
  PoseRequest pose_request = read_body(request, options);
  check_scan(pose_request.scan_lidar, options);
  return pose_request;
}

}  // namespace stillmap::server

#include "pose_request_json.hpp"

#include "errors/api_error.hpp"
#include "json/request_json.hpp"
#include "pose/pose_checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

namespace stillmap::server {
namespace {

using RequestJson = nlohmann::json;

/// Of one query without its points: 500 boxes of 10 values each, and some 100 for the rest.
constexpr std::size_t kMostQueryValues = 6'000;

template <std::size_t kCount>
std::array<double, kCount> read_numbers(const RequestJson& object, const char* key,
                                        const std::string& path) {
  const std::string here = path + "." + key;
  const std::string expected = fmt::format("{} numbers", kCount);
  const auto found = object.find(key);
  if (found == object.end())
    throw field_error(ErrorCode::kInvalidRequest, here, "nothing", expected);
  if (!found->is_array() || found->size() != kCount) refuse(here, *found, expected);
  std::array<double, kCount> numbers{};
  for (std::size_t i = 0; i < kCount; ++i) {
    const RequestJson& number = (*found)[i];
    if (!number.is_number()) refuse(here, *found, expected);
    numbers[i] = number.get<double>();
  }
  return numbers;
}

Eigen::Isometry3d read_pose(const RequestJson& object, ErrorCode code, const std::string& path) {
  return checked_pose(read_numbers<3>(object, "position", path),
                      read_numbers<4>(object, "quaternion", path),
                      {code, path + ".position", path + ".quaternion"});
}

std::optional<localization::Prior> read_prior(const RequestJson& request) {
  const auto found = request.find("prior");
  if (found == request.end()) return std::nullopt;
  require_keys(*found, "prior", {"position", "quaternion", "covariance"});
  localization::Prior prior;
  prior.T_map_lidar = read_pose(*found, ErrorCode::kInvalidPrior, "prior");
  if (found->contains("covariance")) {
    prior.covariance = checked_prior_covariance(read_numbers<36>(*found, "covariance", "prior"),
                                                "prior.covariance");
  }
  return prior;
}

double read_number(const RequestJson& object, const char* key, const std::string& path) {
  const std::string here = path + "." + key;
  const auto found = object.find(key);
  if (found == object.end())
    throw field_error(ErrorCode::kInvalidRequest, here, "nothing", "a number");
  if (!found->is_number()) refuse(here, *found, "a number");
  return found->get<double>();
}

std::optional<GnssFix> read_gnss(const RequestJson& request) {
  const auto found = request.find("gnss");
  if (found == request.end()) return std::nullopt;
  require_keys(*found, "gnss", {"latitude_deg", "longitude_deg", "altitude_m", "sigma_m"});
  GnssFix fix{.latitude_deg = read_number(*found, "latitude_deg", "gnss"),
              .longitude_deg = read_number(*found, "longitude_deg", "gnss"),
              .altitude_m = std::nullopt,
              .sigma_m = read_number(*found, "sigma_m", "gnss")};
  if (found->contains("altitude_m")) fix.altitude_m = read_number(*found, "altitude_m", "gnss");
  check_gnss(fix, "gnss");
  return fix;
}

std::vector<maps::Box> read_movable(const RequestJson& list) {
  if (!list.is_array()) refuse("movable", list, "an array");
  if (list.size() > kMaxMovableBoxes) {
    throw field_error(ErrorCode::kInvalidBoxes, "movable", fmt::format("{} boxes", list.size()),
                      fmt::format("at most {}", kMaxMovableBoxes));
  }
  std::vector<maps::Box> boxes;
  for (const RequestJson& each : list) {
    const std::string path = fmt::format("movable[{}]", boxes.size());
    require_keys(each, path, {"centre", "size", "yaw"});
    const auto yaw = each.find("yaw");
    if (yaw == each.end()) {
      throw field_error(ErrorCode::kInvalidRequest, path + ".yaw", "nothing", "a number");
    }
    if (!yaw->is_number()) refuse(path + ".yaw", *yaw, "a number");
    boxes.push_back(checked_box(read_numbers<3>(each, "centre", path),
                                read_numbers<3>(each, "size", path), yaw->get<double>(), path));
  }
  return boxes;
}

/// An integer, or the decimal string that JSON needs beyond 2^53.
std::int64_t read_integer_key(const RequestJson& value, const char* key) {
  if (value.is_string()) return read_integer(key, value.get_ref<const std::string&>());
  const bool fits = value.is_number_integer() &&
                    !(value.is_number_unsigned() && value.get<std::uint64_t>() > INT64_MAX);
  if (!fits) refuse(key, value, "a decimal 64-bit integer");
  return value.get<std::int64_t>();
}

localization::OdometryStep read_odometry(const RequestJson& step) {
  require_keys(step, "odometry", {"since_ns", "position", "quaternion", "covariance"});
  const auto since = step.find("since_ns");
  if (since == step.end()) {
    throw field_error(ErrorCode::kInvalidRequest, "odometry.since_ns", "nothing",
                      "a decimal 64-bit integer");
  }
  const Eigen::Isometry3d T_since_lidar = read_pose(step, ErrorCode::kInvalidOdometry, "odometry");
  return {.since_ns = read_integer_key(*since, "odometry.since_ns"),
          .T_since_lidar = T_since_lidar,
          .covariance = checked_odometry_covariance(
              read_numbers<36>(step, "covariance", "odometry"), T_since_lidar.translation().norm(),
              "odometry.covariance")};
}

std::string read_text(const RequestJson& value, const char* key) {
  if (!value.is_string()) refuse(key, value, "a string");
  return value.get<std::string>();
}

void require_one_place(const std::optional<localization::Prior>& prior,
                       const std::optional<GnssFix>& gnss) {
  if (!prior || !gnss) return;
  throw field_error(ErrorCode::kInvalidRequest, "gnss", "a prior beside it", "one of the two");
}

PoseParameters read_parameters(const RequestJson& request) {
  PoseParameters parameters;
  parameters.prior = read_prior(request);
  parameters.gnss = read_gnss(request);
  require_one_place(parameters.prior, parameters.gnss);
  if (const auto found = request.find("odometry"); found != request.end()) {
    parameters.odometry = read_odometry(*found);
  }
  if (const auto found = request.find("T_base_lidar"); found != request.end()) {
    require_keys(*found, "T_base_lidar", {"position", "quaternion"});
    parameters.T_base_lidar = read_pose(*found, ErrorCode::kInvalidTransform, "T_base_lidar");
  }
  if (const auto found = request.find("movable"); found != request.end()) {
    parameters.movable = read_movable(*found);
  }
  if (const auto found = request.find("stamp_ns"); found != request.end()) {
    parameters.stamp_ns = read_integer_key(*found, "stamp_ns");
  }
  if (const auto found = request.find("deadline_ms"); found != request.end()) {
    parameters.deadline = checked_deadline(read_integer_key(*found, "deadline_ms"));
  }
  if (const auto found = request.find("method"); found != request.end()) {
    parameters.method = read_text(*found, "method");
  }
  if (const auto found = request.find("layout"); found != request.end()) {
    parameters.raw_format = raw_format_of(read_text(*found, "layout"));
  }
  return parameters;
}

/// @param lists  those of the whole text; the request's own is moved out.
maps::PointCloud take_points(const RequestJson& request, std::vector<JsonPoints>& lists) {
  const auto found = request.find("points");
  if (found == request.end())
    throw field_error(ErrorCode::kInvalidRequest, "points", "nothing", "an array");
  JsonPoints& list = lists.at(found->get<std::size_t>());
  if (list.error) throw ApiError(*list.error);
  maps::PointCloud cloud;
  cloud.positions = std::move(list.positions);
  return cloud;
}

/// Keys of a request with a scan; the places of the scan differ in one key alone.
std::vector<std::string_view> known_keys(JsonScan scan, ScanPurpose purpose) {
  std::vector<std::string_view> keys = {"T_base_lidar", "movable", "stamp_ns"};
  const bool is_sealed = purpose == ScanPurpose::kSealed || purpose == ScanPurpose::kSetSealed;
  const bool is_of_session = purpose == ScanPurpose::kSession || is_sealed;
  if (is_of_session) keys.emplace_back("odometry");
  if (!is_of_session || is_sealed) keys.insert(keys.end(), {"prior", "gnss"});
  if (!is_of_session) keys.emplace_back("method");
  if (purpose != ScanPurpose::kBatchItem) keys.emplace_back("deadline_ms");
  if (scan == JsonScan::kInside) keys.emplace_back("points");
  if (scan == JsonScan::kRawBeside) keys.emplace_back("layout");
  return keys;
}

JsonPoseRequest read_request(const RequestJson& request, JsonScan scan, ScanPurpose purpose,
                             std::vector<JsonPoints>& lists) {
  require_keys(request, "", known_keys(scan, purpose));
  JsonPoseRequest result;
  result.parameters = read_parameters(request);
  if (scan == JsonScan::kInside) result.scan_lidar = take_points(request, lists);
  return result;
}

/// @param depth  of the objects that are queries.
JsonWithPoints parse(std::string_view text, JsonScan scan, const ServerOptions& options,
                     const JsonBounds& bounds, std::size_t depth) {
  if (scan != JsonScan::kInside) return {parse_request_json(text, bounds), {}};
  return parse_json_with_points(text, bounds, depth, options.max_scan_points);
}

}  // namespace

JsonPoseRequest read_pose_request_json(std::string_view text, JsonScan scan, ScanPurpose purpose,
                                       const ServerOptions& options,
                                       std::function<void()> require_wanted) {
  JsonWithPoints parsed = parse(text, scan, options,
                                {.max_bytes = options.max_json_bytes,
                                 .max_values = kMostQueryValues,
                                 .require_wanted = std::move(require_wanted)},
                                1);
  return read_request(parsed.json, scan, purpose, parsed.lists);
}

JsonBatch read_batch_json(std::string_view text, JsonScan scan, const ServerOptions& options,
                          std::function<void()> require_wanted) {
  const auto most = static_cast<std::size_t>(options.batch.max_scans);
  // A query stands in the array of queries, which stands in the request.
  constexpr std::size_t kQueryDepth = 3;
  JsonWithPoints parsed = parse(text, scan, options,
                                {.max_bytes = options.max_json_bytes,
                                 .max_values = kMostQueryValues * most,
                                 .require_wanted = std::move(require_wanted)},
                                kQueryDepth);
  const RequestJson& batch = parsed.json;
  require_keys(batch, "", {"queries", "deadline_ms"});
  JsonBatch result;
  if (const auto found = batch.find("deadline_ms"); found != batch.end()) {
    result.deadline = checked_deadline(read_integer_key(*found, "deadline_ms"));
  }
  const auto queries = batch.find("queries");
  if (queries == batch.end() || !queries->is_array()) {
    throw field_error(ErrorCode::kInvalidRequest, "queries", "no array", "an array");
  }
  if (queries->empty() || queries->size() > most) {
    throw field_error(queries->empty() ? ErrorCode::kInvalidRequest : ErrorCode::kPayloadTooLarge,
                      "queries", fmt::format("{} queries", queries->size()),
                      fmt::format("1 to {}", most));
  }
  for (const RequestJson& each : *queries) {
    JsonBatch::Item& item = result.items.emplace_back();
    try {
      item.request = read_request(each, scan, ScanPurpose::kBatchItem, parsed.lists);
    } catch (const ApiError& error) {
      item.error = error;
    }
  }
  return result;
}

namespace {

std::string read_label(const RequestJson& value) {
  std::string label = value.is_string() ? value.get<std::string>() : std::string{};
  if (!is_label(label)) refuse("label", value, kLabelRule);
  return label;
}

}  // namespace

SessionRequest read_session_json(std::string_view text, bool opens, const ServerOptions& options) {
  const RequestJson request =
      parse_request_json(text.empty() ? std::string_view("{}") : text,
                         {.max_bytes = options.max_json_bytes, .max_values = kMostQueryValues});
  SessionRequest result;
  if (opens) {
    require_keys(request, "", {"map", "version", "set", "label", "prior", "gnss"});
    if (request.contains("map")) result.map = read_text(request["map"], "map");
    if (request.contains("set")) result.set = read_text(request["set"], "set");
    if (!result.set.empty() && !result.map.empty())
      throw field_error(ErrorCode::kInvalidRequest, "set", "a map beside it", "one of the two");
    if (request.contains("version") && result.map.empty())
      throw field_error(ErrorCode::kInvalidRequest, "version", "a version without a map",
                        "the map's name beside it");
    if (request.contains("version")) result.version = read_text(request["version"], "version");
    if (request.contains("label")) result.label = read_label(request["label"]);
  } else {
    require_keys(request, "", {"prior", "gnss"});
  }
  result.prior = read_prior(request);
  result.gnss = read_gnss(request);
  require_one_place(result.prior, result.gnss);
  if (result.prior && !result.prior->covariance) {
    throw field_error(ErrorCode::kInvalidPrior, "prior.covariance", "nothing",
                      "36 numbers: a session weighs the prior against what follows");
  }
  return result;
}

}  // namespace stillmap::server

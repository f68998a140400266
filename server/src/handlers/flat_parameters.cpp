#include "handlers/flat_parameters.hpp"

#include "errors/api_error.hpp"
#include "pose/pose_checks.hpp"
#include "store/map_name.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <charconv>
#include <map>
#include <span>
#include <string_view>

namespace stillmap::server {
namespace {

using Values = std::map<std::string, std::string, std::less<>>;

/// The last one for sets alone.
constexpr std::array<std::string_view, 9> kQueryNames = {
    "stamp_ns", "deadline_ms", "prior_t",         "prior_q",    "prior_sigma",
    "gnss",     "method",      kVehicleParameter, kSetParameter};
constexpr std::array<std::string_view, 6> kSessionNames = {
    "stamp_ns", "deadline_ms", "odom_since_ns", "odom_t", "odom_q", "odom_sigma"};
constexpr std::array<std::string_view, 12> kSealedNames = {
    "stamp_ns", "deadline_ms", "odom_since_ns", "odom_t", "odom_q",          "odom_sigma",
    "prior_t",  "prior_q",     "prior_sigma",   "gnss",   kVehicleParameter, kSetParameter};

std::span<const std::string_view> names_of(ScanPurpose purpose) {
  if (purpose == ScanPurpose::kSession) return kSessionNames;
  const bool is_sealed = purpose == ScanPurpose::kSealed || purpose == ScanPurpose::kSetSealed;
  const std::span<const std::string_view> all =
      is_sealed ? std::span<const std::string_view>(kSealedNames) : kQueryNames;
  return has_set(purpose) ? all : all.first(all.size() - 1);
}

Values unique_values(const std::vector<std::pair<std::string, std::string>>& query,
                     bool takes_layout, ScanPurpose purpose) {
  const std::span<const std::string_view> names = names_of(purpose);
  Values values;
  for (const auto& [name, value] : query) {
    bool known = takes_layout && name == "layout";
    for (const std::string_view each : names) known = known || name == each;
    if (!known) {
      throw field_error(
          ErrorCode::kUnknownParameter, "query", "'" + name + "'",
          fmt::format("{}{}", fmt::join(names, ", "), takes_layout ? ", layout" : ""));
    }
    if (!values.emplace(name, value).second) {
      throw field_error(ErrorCode::kInvalidRequest, name, "it twice", "it once");
    }
  }
  return values;
}

template <std::size_t kCount>
std::array<double, kCount> read_numbers(const std::string& name, const std::string& text) {
  std::array<double, kCount> numbers{};
  const char* at = text.data();
  const char* const end = text.data() + text.size();
  for (std::size_t i = 0; i < kCount; ++i) {
    const auto [next, error] = std::from_chars(at, end, numbers[i]);
    const bool separated = i + 1 == kCount ? next == end : (next != end && *next == ',');
    if (error != std::errc{} || !separated) {
      throw field_error(ErrorCode::kInvalidRequest, name, "'" + text + "'",
                        fmt::format("{} numbers separated by commas", kCount));
    }
    at = next + 1;
  }
  return numbers;
}

Eigen::Matrix<double, 6, 6> read_sigma(const std::string& name, const std::string& text,
                                       ErrorCode code) {
  const auto [sigma_m, sigma_rad] = read_numbers<2>(name, text);
  const auto usable = [](double sigma) { return sigma >= kMinSigma && sigma <= kMaxSigma; };
  if (!usable(sigma_m) || !usable(sigma_rad)) {
    throw field_error(code, name, "'" + text + "'", "metres and radians, each in [1e-9, 1e6]");
  }
  Eigen::Matrix<double, 6, 1> variances;
  variances << Eigen::Vector3d::Constant(sigma_m * sigma_m),
      Eigen::Vector3d::Constant(sigma_rad * sigma_rad);
  return variances.asDiagonal();
}

std::optional<localization::Prior> read_prior(const Values& values) {
  const auto position = values.find("prior_t");
  const auto quaternion = values.find("prior_q");
  const auto sigma = values.find("prior_sigma");
  if (position == values.end() && quaternion == values.end() && sigma == values.end()) {
    return std::nullopt;
  }
  if (position == values.end() || quaternion == values.end()) {
    const bool lacks_position = position == values.end();
    throw field_error(ErrorCode::kInvalidRequest, lacks_position ? "prior_t" : "prior_q", "nothing",
                      lacks_position ? "x,y,z" : "x,y,z,w");
  }
  localization::Prior prior;
  prior.T_map_lidar = checked_pose(read_numbers<3>("prior_t", position->second),
                                   read_numbers<4>("prior_q", quaternion->second),
                                   {ErrorCode::kInvalidPrior, "prior_t", "prior_q"});
  if (sigma != values.end())
    prior.covariance = read_sigma("prior_sigma", sigma->second, ErrorCode::kInvalidPrior);
  return prior;
}

/// `latitude,longitude,altitude,sigma`; the altitude may be left empty.
std::optional<GnssFix> read_gnss(const Values& values) {
  const auto found = values.find("gnss");
  if (found == values.end()) return std::nullopt;
  std::string text = found->second;
  const std::size_t empty = text.find(",,");
  const bool has_altitude = empty == std::string::npos;
  if (!has_altitude) text.erase(empty, 1);
  GnssFix fix;
  if (has_altitude) {
    const auto numbers = read_numbers<4>("gnss", text);
    fix = {numbers[0], numbers[1], numbers[2], numbers[3]};
  } else {
    const auto numbers = read_numbers<3>("gnss", text);
    fix = {numbers[0], numbers[1], std::nullopt, numbers[2]};
  }
  check_gnss(fix, "gnss");
  return fix;
}

std::optional<localization::OdometryStep> read_odometry(const Values& values) {
  constexpr std::array<const char*, 4> kNames = {"odom_since_ns", "odom_t", "odom_q", "odom_sigma"};
  std::array<std::string, 4> texts;
  std::size_t there = 0;
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const auto found = values.find(kNames[i]);
    if (found == values.end()) continue;
    texts[i] = found->second;
    ++there;
  }
  if (there == 0) return std::nullopt;
  for (std::size_t i = 0; i < kNames.size() && there < kNames.size(); ++i) {
    if (values.contains(kNames[i])) continue;
    throw field_error(ErrorCode::kInvalidRequest, kNames[i], "nothing",
                      "odom_since_ns, odom_t, odom_q and odom_sigma together");
  }
  return localization::OdometryStep{
      .since_ns = read_integer(kNames[0], texts[0]),
      .T_since_lidar =
          checked_pose(read_numbers<3>(kNames[1], texts[1]), read_numbers<4>(kNames[2], texts[2]),
                       {ErrorCode::kInvalidOdometry, kNames[1], kNames[2]}),
      .covariance = read_sigma(kNames[3], texts[3], ErrorCode::kInvalidOdometry)};
}

}  // namespace

PoseParameters read_flat_parameters(const std::vector<std::pair<std::string, std::string>>& query,
                                    bool takes_layout, ScanPurpose purpose) {
  const Values values = unique_values(query, takes_layout, purpose);
  const auto value_of = [&](std::string_view name) {
    const auto found = values.find(name);
    return found == values.end() ? std::optional<std::string>{} : found->second;
  };
  PoseParameters parameters;
  parameters.prior = read_prior(values);
  parameters.gnss = read_gnss(values);
  if (parameters.prior && parameters.gnss) {
    throw field_error(ErrorCode::kInvalidRequest, "gnss", "a prior beside it", "one of the two");
  }
  parameters.odometry = read_odometry(values);
  if (const auto text = value_of("stamp_ns")) parameters.stamp_ns = read_integer("stamp_ns", *text);
  parameters.deadline = read_flat_deadline(query);
  if (const auto text = value_of("method")) parameters.method = *text;
  if (const auto text = value_of("layout")) parameters.raw_format = raw_format_of(*text);
  return parameters;
}

std::string read_vehicle(const std::vector<std::pair<std::string, std::string>>& query) {
  std::string label;
  for (const auto& [name, value] : query) {
    if (name != kVehicleParameter) continue;
    if (!label.empty()) throw field_error(ErrorCode::kInvalidRequest, name, "it twice", "it once");
    if (!is_label(value))
      throw field_error(ErrorCode::kInvalidRequest, name, "'" + value + "'", kLabelRule);
    label = value;
  }
  return label;
}

std::string read_set(const std::vector<std::pair<std::string, std::string>>& query) {
  std::string set;
  for (const auto& [name, value] : query) {
    if (name != kSetParameter) continue;
    if (!set.empty()) throw field_error(ErrorCode::kInvalidRequest, name, "it twice", "it once");
    if (!is_valid_map_name(value))
      throw field_error(ErrorCode::kInvalidRequest, name, "'" + value + "'",
                        "[a-z0-9][a-z0-9._-]{0,62}");
    set = value;
  }
  return set;
}

void require_vehicle_alone(const std::vector<std::pair<std::string, std::string>>& query,
                           const std::string& expected) {
  for (const auto& [name, value] : query)
    if (name != kVehicleParameter)
      throw field_error(ErrorCode::kUnknownParameter, "query", "'" + name + "'", expected);
}

std::optional<std::chrono::milliseconds> read_flat_deadline(
    const std::vector<std::pair<std::string, std::string>>& query) {
  for (const auto& [name, value] : query) {
    if (name == "deadline_ms") return checked_deadline(read_integer(name, value));
  }
  return std::nullopt;
}

}  // namespace stillmap::server

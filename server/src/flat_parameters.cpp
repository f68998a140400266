#include "flat_parameters.hpp"

#include "api_error.hpp"
#include "pose_checks.hpp"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <map>
#include <string_view>

namespace stillmap::server {
namespace {

using Values = std::map<std::string, std::string, std::less<>>;

Values unique_values(const std::vector<std::pair<std::string, std::string>>& query,
                     bool takes_layout) {
  constexpr std::array<std::string_view, 6> kKnown = {"prior_t",  "prior_q", "prior_sigma",
                                                      "stamp_ns", "method",  "deadline_ms"};
  Values values;
  for (const auto& [name, value] : query) {
    bool known = takes_layout && name == "layout";
    for (const std::string_view each : kKnown) known = known || name == each;
    if (!known) {
      throw field_error(ErrorCode::kUnknownParameter, "query", "'" + name + "'",
                        "prior_t, prior_q, prior_sigma, stamp_ns, method, deadline_ms" +
                            std::string(takes_layout ? ", layout" : ""));
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

Eigen::Matrix<double, 6, 6> read_sigma(const std::string& text) {
  const auto [sigma_m, sigma_rad] = read_numbers<2>("prior_sigma", text);
  const auto usable = [](double sigma) { return sigma >= kMinSigma && sigma <= kMaxSigma; };
  if (!usable(sigma_m) || !usable(sigma_rad)) {
    throw field_error(ErrorCode::kInvalidPrior, "prior_sigma", "'" + text + "'",
                      "metres and radians, each in [1e-9, 1e6]");
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
  if (sigma != values.end()) prior.covariance = read_sigma(sigma->second);
  return prior;
}

}  // namespace

PoseParameters read_flat_parameters(const std::vector<std::pair<std::string, std::string>>& query,
                                    bool takes_layout) {
  const Values values = unique_values(query, takes_layout);
  const auto value_of = [&](std::string_view name) {
    const auto found = values.find(name);
    return found == values.end() ? std::optional<std::string>{} : found->second;
  };
  PoseParameters parameters;
  parameters.prior = read_prior(values);
  if (const auto text = value_of("stamp_ns")) parameters.stamp_ns = read_integer("stamp_ns", *text);
  if (const auto text = value_of("deadline_ms")) {
    parameters.deadline = checked_deadline(read_integer("deadline_ms", *text));
  }
  if (const auto text = value_of("method")) parameters.method = *text;
  if (const auto text = value_of("layout")) parameters.has_intensity = layout_has_intensity(*text);
  return parameters;
}

}  // namespace stillmap::server

#include "pose_response.hpp"

#include "bodies/answers_json.hpp"
#include "errors/api_error.hpp"
#include "http/header_text.hpp"
#include "http/problem.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string>
#include <string_view>

namespace stillmap::server {
namespace {

constexpr std::string_view kGeoPose = "application/geopose+json";
constexpr std::string_view kGeoPoseVersion = "1.0";
constexpr std::string_view kBasicQuaternion = "basic-quaternion";
constexpr std::string_view kAdvanced = "advanced";

/// @param item  of Accept, of the type GeoPose. @return nothing for what is not written here.
std::optional<GeoPoseTarget> geopose_target(std::string_view item) {
  const std::string version = parameter_of(item, "version");
  if (!version.empty() && version != kGeoPoseVersion) return std::nullopt;
  const std::string profile = lower(parameter_of(item, "profile"));
  if (profile.empty() || profile == kBasicQuaternion) return GeoPoseTarget::kBasicQuaternion;
  if (profile == kAdvanced) return GeoPoseTarget::kAdvanced;
  return std::nullopt;
}

/// How exactly a media range names JSON: the most exact one counts. 0 = not at all.
int names_json(std::string_view type) {
  if (type == "application/json") return 3;
  if (type == "application/*") return 2;
  return type == "*/*" ? 1 : 0;
}

/// Weights of both forms.
struct Wanted {
  bool names_geopose = false;
  std::optional<GeoPoseTarget> target;
  double geopose = 0.0;
  double json = 0.0;
};

Wanted read_accept(std::string_view accept) {
  Wanted wanted;
  int exactness = 0;
  for (std::size_t begin = 0; begin < accept.size();) {
    const std::size_t end = std::min(accept.find(',', begin), accept.size());
    const std::string_view item = accept.substr(begin, end - begin);
    const std::string type = media_type(item);
    const double weight = weight_of(item);
    if (type == kGeoPose) {
      wanted.names_geopose = true;
      const auto target = geopose_target(item);
      if (target && weight > wanted.geopose) {
        wanted.target = target;
        wanted.geopose = weight;
      }
    } else if (names_json(type) > exactness) {
      exactness = names_json(type);
      wanted.json = weight;
    }
    begin = end + 1;
  }
  return wanted;
}

PoseForms forms_in(const HttpRequest& request) {
  const std::string accept = request.header("accept");
  const Wanted wanted = read_accept(accept);
  if (!wanted.names_geopose) return {};
  PoseForms forms{.geopose = std::nullopt, .json = wanted.json > 0.0};
  if (wanted.target && wanted.geopose >= wanted.json) forms.geopose = wanted.target;
  if (!forms.geopose && !forms.json) {
    throw field_error(ErrorCode::kNotAcceptable, "Accept", "'" + accept + "'",
                      fmt::format("application/json, or {} of version {} with profile {} or {}",
                                  kGeoPose, kGeoPoseVersion, kBasicQuaternion, kAdvanced));
  }
  return forms;
}

void add_status_headers(HttpResponse& response, const localization::AlignmentResult& result) {
  response.headers.emplace_back("Stillmap-Status", localization::name_of(result.status));
  if (!result.reasons.empty()) {
    response.headers.emplace_back(
        "Stillmap-Reasons",
        fmt::format("{}", fmt::join(localization::names_of(result.reasons), ", ")));
  }
}

HttpResponse lost_response(const PoseAnswer& answer) {
  const ApiError error(
      ErrorCode::kNoPose,
      fmt::format(
          "lost ({}): there is no pose to give as GeoPose; take application/json too for the "
          "whole answer",
          fmt::join(localization::names_of(answer.result.reasons), ", ")));
  return problem_response(error, answer.request_id);
}

[[noreturn]] void refuse_geopose() {
  throw field_error(ErrorCode::kNotAcceptable, "Accept",
                    fmt::format("{} for a map without geodetic_origin", kGeoPose),
                    "application/json, or a map with a place on the Earth (build --geo-origin)");
}

}  // namespace

PoseForms pose_forms(const HttpRequest& request, const ServedVersion& map) {
  PoseForms forms = forms_in(request);
  if (!forms.geopose || map.package->manifest().geodetic_origin) return forms;
  if (!forms.json) refuse_geopose();
  forms.geopose.reset();
  return forms;
}

void require_json_taken(const HttpRequest& request) {
  if (forms_in(request).json) return;
  throw field_error(ErrorCode::kNotAcceptable, "Accept", fmt::format("{} alone", kGeoPose),
                    "application/json: a batch has no GeoPose, ask for each scan by itself");
}

HttpResponse pose_response(const PoseAnswer& answer, const PoseForms& forms,
                           const ServedVersion& map) {
  if (!forms.geopose) return json_response(pose_answer_json(answer));
  // In a set, another map than the first may be without.
  if (!map.package->manifest().geodetic_origin) {
    if (!forms.json) refuse_geopose();
    return json_response(pose_answer_json(answer));
  }
  HttpResponse response;
  if (answer.result.status == localization::PoseStatus::kLost) {
    response = forms.json ? json_response(pose_answer_json(answer)) : lost_response(answer);
  } else {
    response.body = geopose_json(answer, *forms.geopose, *map.package->manifest().geodetic_origin);
    response.content_type = fmt::format("{}; version={}", kGeoPose, kGeoPoseVersion);
    if (*forms.geopose == GeoPoseTarget::kAdvanced)
      response.content_type += fmt::format("; profile={}", kAdvanced);
  }
  add_status_headers(response, answer.result);
  return response;
}

}  // namespace stillmap::server

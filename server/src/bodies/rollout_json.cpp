#include "bodies/rollout_json.hpp"

#include "json/json_values.hpp"
#include "json/request_json.hpp"
#include "pose/pose_checks.hpp"
#include "store/map_name.hpp"

namespace stillmap::server {
namespace {

constexpr std::size_t kMostPatterns = 100;

/// In [0, 1]; as it was when it is not told.
void read_share(const nlohmann::json& object, const char* key, const std::string& path,
                double& share) {
  const auto found = object.find(key);
  if (found == object.end()) return;
  const double value = found->is_number() ? found->get<double>() : -1.0;
  if (!(value >= 0.0 && value <= 1.0)) refuse(path + key, *found, "0 to 1");
  share = value;
}

HaltOptions read_halt(const nlohmann::json& halt) {
  constexpr std::int64_t kMostAnswers = 1'000'000;
  require_keys(halt, "halt", {"least_answers", "most_rise"});
  HaltOptions options;
  if (const auto least = halt.find("least_answers"); least != halt.end()) {
    if (!least->is_number_integer() || *least < 1 || *least > kMostAnswers)
      refuse("halt.least_answers", *least, "1 to 1000000");
    options.least_answers = least->get<std::int64_t>();
  }
  read_share(halt, "most_rise", "halt.", options.most_rise);
  return options;
}

Json counts(const AnswerCounts& answers) {
  return {{"ok", answers.ok}, {"degraded", answers.degraded}, {"lost", answers.lost}};
}

}  // namespace

Rollout read_rollout_json(std::string_view text) {
  const nlohmann::json request =
      parse_request_json(text, {.max_bytes = kMostRolloutJson, .max_values = 200});
  require_keys(request, "", {"version", "share", "vehicles", "halt"});
  Rollout rollout;
  const nlohmann::json version = request.value("version", nlohmann::json());
  if (version.is_string()) rollout.version = version.get<std::string>();
  if (!is_valid_map_name(rollout.version)) refuse("version", version, "the name of a version");
  read_share(request, "share", "", rollout.share);
  if (const auto vehicles = request.find("vehicles"); vehicles != request.end()) {
    if (!vehicles->is_array() || vehicles->size() > kMostPatterns)
      refuse("vehicles", *vehicles, "at most 100 labels, in which * stands for any text");
    for (const nlohmann::json& each : *vehicles) {
      rollout.vehicles.push_back(each.is_string() ? each.get<std::string>() : std::string{});
      if (!is_label(rollout.vehicles.back())) refuse("vehicles", each, kLabelRule);
    }
  }
  if (const auto halt = request.find("halt"); halt != request.end())
    rollout.halt = read_halt(*halt);
  return rollout;
}

std::string rollout_json(const Rollout& rollout, const RolloutFigures& figures,
                         std::string_view state) {
  return to_text(
      Json{{"map", rollout.map},
           {"state", rollout.halted ? "halted" : "running"},
           {"reason", rollout.reason},
           {"version", rollout.version},
           {"version_state", state},
           {"active_version", rollout.active},
           {"share", rollout.share},
           {"vehicles", rollout.vehicles},
           {"halt",
            {{"least_answers", rollout.halt.least_answers}, {"most_rise", rollout.halt.most_rise}}},
           {"begun_ns", time_of(rollout.begun_ns)},
           {"answers",
            {{"rollout", counts(figures.rollout)},
             {"others", counts(figures.others)},
             {"before", counts(figures.before)}}}});
}

std::string no_rollout_json(const std::string& map) {
  return to_text(Json{{"map", map}, {"state", "none"}});
}

std::string vehicle_list_json(const std::vector<VehicleTable::Vehicle>& vehicles,
                              const std::optional<std::string>& next) {
  Json json;
  json["vehicles"] = Json::array();
  for (const VehicleTable::Vehicle& each : vehicles)
    json["vehicles"].push_back({{"label", each.label},
                                {"version", each.version},
                                {"last_seen_ns", time_of(each.last_seen_ns)},
                                {"answers", counts(each.answers)}});
  json["next"] = next ? Json(*next) : Json();
  return to_text(json);
}

}  // namespace stillmap::server

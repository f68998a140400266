#include <stillmap/mapping/odometry_evaluation.hpp>

#include "evaluation/odometry/errors_json.hpp"

#include <utility>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

Json loops_json(const LoopScores& loops) {
  Json json{{"found", loops.found},
            {"precision", number_json(loops.precision)},
            {"recall", number_json(loops.recall)},
            {"right", loops.right},
            {"revisits", loops.revisits},
            {"revisits_found", loops.revisits_found}};
  json["all"] = Json::array();
  for (const EvaluatedLoop& loop : loops.loops)
    json["all"].push_back({{"from_scan", loop.from_scan},
                           {"to_scan", loop.to_scan},
                           {"translation_error_m", number_json(loop.translation_error_m)},
                           {"rotation_error_deg", number_json(loop.rotation_error_deg)},
                           {"weight", number_json(loop.weight)},
                           {"right", loop.right}});
  return json;
}

Json options_json(const OdometryEvaluationOptions& options) {
  return {{"odometry", options.method},
          {"loops", options.loops},
          {"movable", name_of(options.movable)},
          {"detector",
           options.movable == MovablePolicy::kKeep ? Json(nullptr) : Json(options.detector)},
          {"threads", options.threads}};
}

}  // namespace

std::string to_json(const OdometryEvaluation& evaluation) {
  Json json = errors_json(evaluation.errors());
  json["loops"] = evaluation.loops ? loops_json(*evaluation.loops) : Json(nullptr);
  json["scans_per_second"] = evaluation.scans_per_second;
  json["status"] = {{"matched", evaluation.matched},
                    {"partly", evaluation.partly},
                    {"predicted", evaluation.predicted}};
  Json &hidden = json["scans_hidden"] = Json::array(),
       &anew = json["scans_begun_anew"] = Json::array();
  for (const FollowedScan& scan : evaluation.path) {
    if (scan.hidden) hidden.push_back(scan.scan);
    if (scan.begins_anew) anew.push_back(scan.scan);
  }
  json["points"] = {{"in", evaluation.points.in},
                    {"projected", evaluation.points.projected},
                    {"deleted", evaluation.points.deleted}};
  json["keyframes"] = evaluation.keyframes.size();
  json["without_loops"] = errors_json(evaluation.odometry);
  json["with_loops"] = evaluation.corrected ? errors_json(*evaluation.corrected) : Json(nullptr);
  json["notes"] = evaluation.notes;
  json["scans"] = evaluation.scans;
  json["seconds"] = evaluation.seconds;
  json["stage_seconds"] = {{"odometry", evaluation.odometry_seconds},
                           {"loops", evaluation.loop_seconds},
                           {"pose_graph", evaluation.graph_seconds}};
  json["options"] = options_json(evaluation.options);
  return json.dump(2);
}

}  // namespace stillmap::mapping

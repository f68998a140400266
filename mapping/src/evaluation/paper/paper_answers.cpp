#include "evaluation/paper/paper_answers.hpp"

#include "evaluation/localization/localization_metrics.hpp"

#include <stillmap/maps/error.hpp>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string_view>

namespace stillmap::mapping {
namespace {

using localization::PoseStatus;
using Json = nlohmann::ordered_json;

std::optional<PoseStatus> status_of(std::string_view name) {
  for (const PoseStatus status : {PoseStatus::kOk, PoseStatus::kDegraded, PoseStatus::kLost}) {
    if (name == localization::name_of(status)) return status;
  }
  return std::nullopt;
}

PaperAnswer answer_of(const LocalizationQuery& query) {
  PaperAnswer answer{.scan = query.scan, .status = query.status};
  const bool lost = query.status == PoseStatus::kLost;
  answer.xy_m = lost ? query.prior_error.metres : query.error.head<2>().norm();
  answer.yaw_rad =
      lost ? query.prior_error.degrees * std::numbers::pi / 180.0 : std::abs(query.error[5]);
  answer.success = is_success(query);
  return answer;
}

void count_points(const maps::MapPackage& map, PaperAnswers& answers) {
  for (const maps::TileEntry& entry : map.tiles()) {
    if (entry.id.level != 0) continue;
    for (const maps::MapPoint& point : map.tile(entry.id)) {
      if (maps::is_measured(point.kind)) ++answers.measured;
      if (point.kind == maps::PointKind::kProjected) ++answers.projected;
      if (point.kind == maps::PointKind::kFilled) ++answers.filled;
    }
  }
}

Json json_of(const std::string& key, const PaperAnswers& answers) {
  Json json{{"key", key},
            {"map_digest", answers.map_digest},
            {"measured", answers.measured},
            {"projected", answers.projected},
            {"filled", answers.filled},
            {"query_points", answers.query_points},
            {"query_deleted", answers.query_deleted},
            {"cpu_ms", answers.cpu_ms},
            {"scans", Json::array()}};
  for (const PaperAnswer& each : answers.scans)
    json["scans"].push_back({{"scan", each.scan},
                             {"status", localization::name_of(each.status)},
                             {"xy_m", each.xy_m},
                             {"yaw_rad", each.yaw_rad},
                             {"success", each.success}});
  return json;
}

std::optional<PaperAnswers> answers_of(const Json& json, const std::string& key) {
  if (json.at("key") != key) return std::nullopt;
  PaperAnswers answers;
  answers.map_digest = json.at("map_digest");
  answers.measured = json.at("measured");
  answers.projected = json.at("projected");
  answers.filled = json.at("filled");
  answers.query_points = json.at("query_points");
  answers.query_deleted = json.at("query_deleted");
  answers.cpu_ms = json.at("cpu_ms");
  for (const Json& each : json.at("scans")) {
    PaperAnswer answer{.scan = each.at("scan"),
                       .xy_m = each.at("xy_m"),
                       .yaw_rad = each.at("yaw_rad"),
                       .success = each.at("success")};
    const auto status = status_of(each.at("status").get<std::string>());
    if (!status) return std::nullopt;
    answer.status = *status;
    answers.scans.push_back(answer);
  }
  if (answers.scans.empty()) return std::nullopt;
  return answers;
}

}  // namespace

PaperAnswers paper_answers(const LocalizationEvaluation& evaluation, const maps::MapPackage& map) {
  PaperAnswers answers;
  for (const LocalizationQuery& query : evaluation.queries.at(0))
    answers.scans.push_back(answer_of(query));
  answers.map_digest = map.digest();
  count_points(map, answers);
  answers.query_points = evaluation.points.in;
  answers.query_deleted = evaluation.points.deleted;
  answers.cpu_ms = evaluation.levels.at(0).cpu_ms.p50;
  return answers;
}

void write_answers(const std::filesystem::path& file, const std::string& key,
                   const PaperAnswers& answers) {
  std::filesystem::path partial = file;
  partial += ".partial";
  std::ofstream out(partial, std::ios::binary);
  out << json_of(key, answers).dump() << '\n';
  out.close();
  if (!out) throw maps::StorageError(partial.string(), "cannot be written");
  std::error_code error;
  std::filesystem::rename(partial, file, error);
  if (error) throw maps::StorageError(file.string(), error.message());
}

std::optional<PaperAnswers> read_answers(const std::filesystem::path& file,
                                         const std::string& key) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return std::nullopt;
  try {
    return answers_of(Json::parse(in), key);
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

}  // namespace stillmap::mapping

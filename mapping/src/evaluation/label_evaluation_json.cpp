#include <stillmap/mapping/label_evaluation.hpp>

#include <nlohmann/json.hpp>

#include <cmath>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

/// Numbers that are not there (NaN) become null.
Json nan_as_null(double value) { return std::isnan(value) ? Json(nullptr) : Json(value); }

Json counted(const Share& share) { return {{"count", share.count}, {"of", share.of}}; }

void put_scores(Json& out, const MapScores& scores) {
  out["SA"] = nan_as_null(scores.SA);
  out["DA"] = nan_as_null(scores.DA);
  out["AA"] = nan_as_null(scores.AA);
  out["HA"] = nan_as_null(scores.HA);
  out["PR"] = nan_as_null(scores.PR);
  out["RR"] = nan_as_null(scores.RR);
  out["F1"] = nan_as_null(scores.F1);
}

Json block(const MapScores& scores) {
  Json out;
  put_scores(out, scores);
  out["DA_plain"] = nan_as_null(scores.plain_removed.rate());
  out["static_loss"] = nan_as_null(scores.static_loss);
  out["counts"] = {{"static_kept", counted(scores.static_kept)},
                   {"dynamic_removed", counted(scores.dynamic_removed)},
                   {"dynamic_removed_plain", counted(scores.plain_removed)},
                   {"static_voxels_kept", counted(scores.static_voxels_kept)},
                   {"dynamic_voxels_kept", counted(scores.dynamic_voxels_kept)},
                   {"static_lost", counted(scores.static_lost)},
                   {"static_lost_uncleaned", counted(scores.static_lost_uncleaned)}};
  return out;
}

void put_ground(Json& out, const MapFigures& figures) {
  out["ground_completeness"] = nan_as_null(figures.ground_under.filled.rate());
  out["ground_completeness_projected"] = nan_as_null(figures.ground_under.projected.rate());
}

/// By distance from the path.
Json bands(const MapFigures& figures) {
  Json out = Json::array();
  for (const GroundUnderBand& band : figures.ground_bands) {
    out.push_back({{"to_m", std::isfinite(band.to_m) ? Json(band.to_m) : Json(nullptr)},
                   {"cells", band.ground.filled.of},
                   {"projected", nan_as_null(band.ground.projected.rate())},
                   {"filled", nan_as_null(band.ground.filled.rate())},
                   {"wrong", band.ground.wrong}});
  }
  return out;
}

Json losses(const MapFigures& figures) {
  Json out = Json::object();
  for (const ClassLoss& loss : figures.losses) {
    out[loss.name] = {{"label", loss.label},
                      {"loss", nan_as_null(loss.loss)},
                      {"lost", loss.lost.count},
                      {"lost_uncleaned", loss.lost_uncleaned.count},
                      {"points", loss.lost.of}};
  }
  return out;
}

Json figures(const MapFigures& figures) {
  Json out;
  out["moving"] = block(figures.of(TruthClasses::kMoving));
  out["movable"] = block(figures.of(TruthClasses::kMovable));
  out["parked_removal"] = nan_as_null(figures.parked_removed.rate());
  put_ground(out, figures);
  out["static_loss_by_class"] = losses(figures);
  return out;
}

Json heights(const HeightErrors& errors) {
  return {{"median", nan_as_null(errors.median_m)},
          {"p95", nan_as_null(errors.p95_m)},
          {"points", errors.points}};
}

Json heights(const std::optional<GroundHeights>& known) {
  if (!known) return {{"median", nullptr}, {"p95", nullptr}};
  Json out = heights(known->all);
  out["projected"] = heights(known->projected);
  out["filled"] = heights(known->filled);
  out["one_surface"] = heights(known->one_surface);
  out["across_kerb"] = heights(known->across_kerb);
  return out;
}

Json ground(const std::optional<GroundScores>& known) {
  if (!known) return {{"precision", nullptr}, {"recall", nullptr}, {"f1", nullptr}};
  return {{"precision", nan_as_null(known->precision())},
          {"recall", nan_as_null(known->recall())},
          {"f1", nan_as_null(known->f1())},
          {"true_positives", known->true_positives},
          {"false_positives", known->false_positives},
          {"false_negatives", known->false_negatives}};
}

}  // namespace

std::string to_json(const LabelEvaluation& evaluation, TruthClasses classes) {
  const LabelEvaluation& e = evaluation;
  const MapFigures& best = e.figures();
  Json out;
  put_scores(out, best.of(classes));
  out["parked_removal"] = nan_as_null(best.parked_removed.rate());
  out["static_loss"] = nan_as_null(best.of(classes).static_loss);
  put_ground(out, best);
  out["ground_completeness_by_distance"] = bands(best);
  out["filled_height_error_m"] = heights(e.heights);
  out["ground"] = ground(e.ground);
  out["truth_classes"] = name_of(classes);
  out["map_points"] = e.unthinned ? "unthinned" : "thinned";
  out["drive_in_map"] = e.drive_in_map;
  out["drives_in_map"] = e.drives;
  out["true_ground"] = name_of(e.true_ground);
  out["moving"] = block(best.of(TruthClasses::kMoving));
  out["movable"] = block(best.of(TruthClasses::kMovable));
  out["static_loss_by_class"] = losses(best);
  out["thinned"] = figures(e.thinned);
  out["counts"] = {{"points", e.points},
                   {"ignored", e.ignored},
                   {"dropped", e.dropped},
                   {"parked_removed", counted(best.parked_removed)},
                   {"ground_cells_projected", counted(best.ground_under.projected)},
                   {"ground_cells_filled", counted(best.ground_under.filled)},
                   {"ground_cells_wrong", best.ground_under.wrong},
                   {"parked_objects", e.parked_objects},
                   {"moving_objects", e.moving_objects}};
  out["scans"] = e.scans;
  out["seconds"] = e.seconds;
  Json stages = Json::object();
  for (const auto& [stage, seconds] : e.stage_seconds) stages[stage] = seconds;
  out["stage_seconds"] = std::move(stages);
  out["peak_rss_mib"] = e.peak_rss_mib;
  return out.dump(2);
}

}  // namespace stillmap::mapping

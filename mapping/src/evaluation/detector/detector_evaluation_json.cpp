#include <stillmap/mapping/detector_evaluation.hpp>

#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

/// Numbers that are not there (NaN) become null.
Json number(double value) { return std::isnan(value) ? Json(nullptr) : Json(value); }

Json share(const Share& share) {
  return {{"rate", number(share.rate())}, {"count", share.count}, {"of", share.of}};
}

Json recall(const CentreRecall& recall) {
  Json out = share(recall.found);
  out["by_track"] = number(recall.by_track());
  Json tracks = Json::array();
  for (const TrackRecall& track : recall.tracks) {
    tracks.push_back({{"track", track.track},
                      {"class", track.class_name},
                      {"count", track.found.count},
                      {"of", track.found.of}});
  }
  out["tracks"] = std::move(tracks);
  return out;
}

Json average_precisions(const BoxDetection& boxes) {
  Json out = Json::object();
  for (const ClassDetection& each : boxes.classes) {
    Json by_iou = Json::object();
    for (const AveragePrecision& ap : each.average_precision)
      by_iou[fmt::format("{:g}", ap.iou)] = number(ap.value);
    out[each.name] = std::move(by_iou);
  }
  return out;
}

/// Precision and recall of each class if only boxes of a score or more were asked for, in steps of
/// a hundredth, at the overlap that the class is mostly judged by.
Json curves(const BoxDetection& boxes) {
  Json out = Json::object();
  for (const ClassDetection& each : boxes.classes) {
    const AveragePrecision& judged = each.average_precision[each.average_precision.size() / 2];
    Json places = Json::array();
    auto place = judged.curve.begin();
    for (int percent = 99; percent >= 1; --percent) {
      const double score = 0.01 * percent;
      while (place != judged.curve.end() && place->score >= score) ++place;
      if (place == judged.curve.begin()) continue;
      places.push_back({score, std::prev(place)->precision, std::prev(place)->recall});
    }
    out[each.name] = {{"iou", judged.iou}, {"score_precision_recall", std::move(places)}};
  }
  return out;
}

/// Something of each class.
template <typename Value>
Json by_class(const BoxDetection& boxes, const Value& value) {
  Json out = Json::object();
  for (const ClassDetection& each : boxes.classes) out[each.name] = value(each);
  return out;
}

Json thresholds(const BoxDetection& boxes) {
  Json out = Json::array();
  for (const ThresholdDetection& each : boxes.thresholds) {
    out.push_back({{"score", each.score},
                   {"recall_centre_1_5m", number(each.found.rate())},
                   {"well_seen", share(each.well_seen_found)},
                   {"well_seen_by_track", number(each.well_seen_by_track)},
                   {"false_boxes_per_scan", each.false_boxes_per_scan}});
  }
  return out;
}

Json distances(const BoxDetection& boxes) {
  Json out = Json::array();
  for (const DistanceDetection& band : boxes.distances) {
    out.push_back({{"from_m", band.from_m},
                   {"to_m", band.to_m},
                   {"recall_centre_1_5m", share(band.found)},
                   {"AP_0_5", number(band.average_precision)},
                   {"false_boxes_per_scan", band.false_boxes_per_scan}});
  }
  return out;
}

Json visibilities(const BoxDetection& boxes) {
  Json out = Json::array();
  for (const VisibilityDetection& each : boxes.visibilities) {
    out.push_back({{"min_points", each.min_points},
                   {"recall_centre_1_5m", share(each.found)},
                   {"AP_0_5", number(each.average_precision)}});
  }
  return out;
}

void put_boxes(Json& out, const BoxDetection& boxes) {
  out["AP"] = average_precisions(boxes);
  out["curves"] = curves(boxes);
  out["recall_centre_1_5m"] =
      by_class(boxes, [](const ClassDetection& each) { return number(each.all.found.rate()); });
  out["false_boxes_per_scan"] = boxes.false_boxes_per_scan;
  out["well_seen"] =
      by_class(boxes, [](const ClassDetection& each) { return recall(each.well_seen); });
  out["thresholds"] = thresholds(boxes);
  out["distances"] = distances(boxes);
  out["visibilities"] = visibilities(boxes);
  Json held = Json::object();
  for (const auto& [name, count] : boxes.false_boxes_hold) held[name] = count;
  out["false_boxes_hold"] = std::move(held);
  out["truth"] = {{"source", boxes.source}, {"in_camera_only", boxes.in_camera_only}};
  out["counts"] = {
      {"truths", by_class(boxes, [](const ClassDetection& e) { return e.all.found.of; })},
      {"ignored_truths", boxes.ignored_truths},
      {"boxes", boxes.boxes},
      {"false_vehicles", boxes.false_vehicles},
      {"ignored_vehicles", boxes.ignored_vehicles}};
}

Json points(const std::optional<PointDetection>& known) {
  if (!known) return {{"movable_recall", nullptr}, {"static_loss", nullptr}};
  Json out{{"movable_recall", number(known->movable.rate())},
           {"static_loss", number(known->stays.rate())},
           {"static_loss_above_ground", number(known->stays_above_ground.rate())},
           {"scans", known->scans}};
  Json classes = Json::object();
  for (const ClassPoints& each : known->classes) {
    classes[each.name] = share(each.inside);
    classes[each.name]["movable"] = each.movable;
  }
  out["classes"] = std::move(classes);
  return out;
}

}  // namespace

std::string to_json(const DetectorEvaluation& evaluation) {
  Json out;
  if (evaluation.boxes) {
    put_boxes(out, *evaluation.boxes);
  } else {
    for (const char* const name : {"AP", "recall_centre_1_5m", "false_boxes_per_scan"})
      out[name] = nullptr;
  }
  out["points"] = points(evaluation.points);
  if (evaluation.points_as_built) {
    out["points"]["as_built"] = points(evaluation.points_as_built);
    out["points"]["as_built"]["margin_m"] = evaluation.build_margin_m;
  }
  out["ms_per_scan"] = evaluation.detect_ms;
  out["ground_ms_per_scan"] = evaluation.ground_ms;
  out["scans"] = evaluation.scans;
  out["seconds"] = evaluation.seconds;
  out["options"] = {
      {"detector", evaluation.options.detector},
      {"max_range_m", evaluation.options.max_range_m},
      {"boxes", evaluation.options.boxes_file ? Json(evaluation.options.boxes_file->string())
                                              : Json(nullptr)}};
  return out.dump(2);
}

}  // namespace stillmap::mapping

#include <stillmap/mapping/detector_evaluation.hpp>

#include "evaluation/report/page_parts.hpp"
#include "evaluation/report/report_page.hpp"
#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr std::string_view kDetectorStyle = R"(
.views { display: grid; grid-template-columns: repeat(3, 1fr); gap: 14px; } .views img { width: 100%; border-radius: 6px; display: block; }
.views figcaption { padding: 4px 0 0; } @media (max-width: 800px) { .views { grid-template-columns: 1fr; } }
.pair { display: grid; grid-template-columns: 1fr 360px; gap: 24px; align-items: start; } .pair figure { width: 360px; max-width: 100%; }
@media (max-width: 800px) { .pair { grid-template-columns: 1fr; } }
.found { color: #3cdc5a; } .missed { color: #ff3c3c; } .uncounted { color: #828282; } .true { color: #5aaaff; } .false { color: #ff9628; }
.silent { color: #325082; }
)";

std::string counted(const Share& share) {
  if (share.of == 0) return "–";
  return fmt::format("{}<br><small>{} of {}</small>", percent_text(share.rate(), 1),
                     grouped_text(share.count), grouped_text(share.of));
}

/// Writes the page part by part, in the order in which it is read.
class DetectorPage : ReportPage {
 public:
  DetectorPage(const DetectorEvaluation& evaluation, const DetectorReportHeading& heading)
      : ReportPage("Detector report", kDetectorStyle), evaluation_(evaluation), heading_(heading) {}

  [[nodiscard]] std::string page() {
    add_heading();
    add_tiles();
    add_pictures();
    if (evaluation_.boxes) add_boxes(*evaluation_.boxes);
    if (evaluation_.points) add_points(*evaluation_.points);
    add_times();
    return finished();
  }

 private:
  void add_heading() {
    add_title(
        fmt::format("detector <b>{}</b> · drive <b>{}</b> · {} "
                    "scans · within {:g} m",
                    escaped(evaluation_.options.detector), escaped(heading_.drive),
                    evaluation_.scans, evaluation_.options.max_range_m));
    if (!evaluation_.boxes) return;
    html_ += fmt::format(
        "<p>Labelled boxes: {}{}. Labels count with 5 or more points inside; on the others, and on "
        "objects of unknown class, boxes are neither right nor wrong.</p>\n",
        escaped(evaluation_.boxes->source),
        evaluation_.boxes->in_camera_only
            ? ", which hold what a front camera shows: boxes count as false in its image only, "
              "outside of regions without labels"
            : "");
  }

  void add_tiles() {
    html_ += "<div class=\"tiles\">";
    if (evaluation_.boxes) {
      const ClassDetection& vehicle = evaluation_.boxes->classes.front();
      html_ += tile_of(percent_text(vehicle.average_precision.at(1).value, 1),
                       "AP of vehicles, overlap 0.5") +
               tile_of(percent_text(vehicle.all.found.rate(), 1), "of vehicles within 1.5 m") +
               tile_of(percent_text(vehicle.well_seen.found.rate(), 1),
                       "of those with 50 points within 40 m") +
               tile_of(fmt::format("{:.2f}", evaluation_.boxes->false_boxes_per_scan),
                       "false vehicle boxes a scan");
    }
    if (evaluation_.points) {
      html_ += tile_of(percent_text(evaluation_.points->movable.rate(), 1),
                       "of movable points inside of boxes") +
               tile_of(percent_text(evaluation_.points->stays.rate()),
                       "of static points inside of boxes");
    }
    html_ += tile_of(fmt::format("{:.1f} ms", evaluation_.detect_ms), "a scan") + "</div>\n";
  }

  void add_pictures() {
    if (evaluation_.pictures.empty()) return;
    html_ += "<h2>Scans from above</h2>\n<p>Labels: " + key_of_style("found", "found, ") +
             key_of_style("missed", "missed, ") + key_of_style("uncounted", "not counting. ") +
             "Boxes: " + key_of_style("true", "on a label, ") + key_of_style("false", "false, ") +
             key_of_style("silent", "saying nothing.") + "</p>\n<div class=\"views\">";
    for (const ScanPicture& picture : evaluation_.pictures)
      html_ += picture_of(picture.png, fmt::format("Scan {}", picture.scan));
    html_ += "</div>\n";
  }

  static std::string curves(const ClassDetection& vehicle) {
    SvgPlot plot({.label = "recall [%]", .max = 100.0}, {.label = "precision [%]", .max = 100.0});
    for (std::size_t i = 0; i < vehicle.average_precision.size(); ++i) {
      std::vector<SvgPlot::Point> points;
      for (const PrecisionRecall& each : vehicle.average_precision[i].curve)
        points.emplace_back(100.0 * each.recall, 100.0 * each.precision);
      if (!points.empty()) plot.add_line(points, fmt::format("c{}", i));
    }
    return plot.svg("Precision and recall of vehicles");
  }

  void add_boxes(const BoxDetection& boxes) {
    html_ +=
        "<h2>Boxes</h2>\n<div class=\"pair\"><div><table>" +
        row_of({"", "AP 0.3", "AP 0.5", "AP 0.7", "within 1.5 m", "50 points, 40 m", "by track"},
               "th");
    for (const ClassDetection& each : boxes.classes) {
      const auto ap = [&](std::size_t i) {
        return i < each.average_precision.size() ? percent_text(each.average_precision[i].value, 1)
                                                 : std::string();
      };
      html_ += row_of({each.name, ap(0), ap(1), ap(2), counted(each.all.found),
                       counted(each.well_seen.found), percent_text(each.well_seen.by_track(), 1)});
    }
    html_ += "</table></div>\n<figure>" + curves(boxes.classes.front()) +
             "<figcaption>Vehicles at an overlap of " + key_of_style("c0", "0.3, ") +
             key_of_style("c1", "0.5, ") + key_of_style("c2", "0.7") +
             "</figcaption></figure></div>\n";
    add_distances(boxes);
    add_visibilities(boxes);
    add_thresholds(boxes);
    add_tracks(boxes);
    add_false_boxes(boxes);
  }

  void add_distances(const BoxDetection& boxes) {
    html_ += "<h2>Vehicles by distance</h2>\n<table class=\"narrow\">" +
             row_of({"", "within 1.5 m", "AP 0.5", "false boxes a scan"}, "th");
    for (const DistanceDetection& band : boxes.distances) {
      html_ += row_of({fmt::format("{:g} to {:g} m", band.from_m, band.to_m), counted(band.found),
                       percent_text(band.average_precision, 1),
                       fmt::format("{:.2f}", band.false_boxes_per_scan)});
    }
    html_ += "</table>\n";
  }

  void add_visibilities(const BoxDetection& boxes) {
    html_ += "<h2>Vehicles by what is seen of them</h2>\n<table class=\"narrow\">" +
             row_of({"points inside from", "within 1.5 m", "AP 0.5"}, "th");
    for (const VisibilityDetection& each : boxes.visibilities) {
      html_ += row_of({grouped_text(each.min_points), counted(each.found),
                       percent_text(each.average_precision, 1)});
    }
    html_ += "</table>\n";
  }

  void add_thresholds(const BoxDetection& boxes) {
    html_ +=
        "<h2>Vehicles by threshold</h2>\n<table class=\"narrow\">" +
        row_of({"score from", "within 1.5 m", "50 points, 40 m", "by track", "false boxes a scan"},
               "th");
    for (const ThresholdDetection& each : boxes.thresholds) {
      html_ += row_of({fmt::format("{:.2f}", each.score), percent_text(each.found.rate(), 1),
                       percent_text(each.well_seen_found.rate(), 1),
                       percent_text(each.well_seen_by_track, 1),
                       fmt::format("{:.2f}", each.false_boxes_per_scan)});
    }
    html_ += "</table>\n";
  }

  void add_tracks(const BoxDetection& boxes) {
    html_ += "<h2>Tracks of vehicles with 50 points within 40 m</h2>\n<table class=\"narrow\">" +
             row_of({"track", "class", "within 1.5 m"}, "th");
    for (const TrackRecall& track : boxes.classes.front().well_seen.tracks) {
      html_ += row_of({track.track < 0 ? std::string("–") : std::to_string(track.track),
                       track.class_name, counted(track.found)});
    }
    html_ += "</table>\n";
  }

  void add_false_boxes(const BoxDetection& boxes) {
    if (boxes.false_boxes_hold.empty()) return;
    html_ +=
        "<h2>What false vehicle boxes hold</h2>\n<p>By the class of most of their points, "
        "ground left out.</p>\n<table class=\"narrow\">" +
        row_of({"class", "boxes"}, "th");
    for (const auto& [name, count] : boxes.false_boxes_hold)
      html_ += row_of({escaped(name), grouped_text(count)});
    html_ += "</table>\n";
  }

  void add_points(const PointDetection& points) {
    html_ += "<h2>Points inside of boxes</h2>\n<table class=\"narrow\">" +
             row_of({"class", "", "inside"}, "th");
    for (const ClassPoints& each : points.classes)
      html_ +=
          row_of({escaped(each.name), each.movable ? "movable" : "static", counted(each.inside)});
    html_ += row_of({"<b>all movable</b>", "", counted(points.movable)}) +
             row_of({"<b>all static</b>", "", counted(points.stays)}) +
             row_of({"static, found ground left out", "", counted(points.stays_above_ground)}) +
             "</table>\n";
  }

  void add_times() {
    html_ += "<h2>This evaluation</h2>\n<table class=\"narrow\">" +
             row_of({"detector, mean of a scan", fmt::format("{:.1f} ms", evaluation_.detect_ms)}) +
             row_of({"ground before it", fmt::format("{:.1f} ms", evaluation_.ground_ms)}) +
             row_of({"in all", fmt::format("{:.1f} s", evaluation_.seconds)}) + "</table>\n<pre>" +
             escaped(heading_.command) + "</pre>\n";
  }

  const DetectorEvaluation& evaluation_;
  const DetectorReportHeading& heading_;
};

}  // namespace

std::string to_html(const DetectorEvaluation& evaluation, const DetectorReportHeading& heading) {
  return DetectorPage(evaluation, heading).page();
}

}  // namespace stillmap::mapping

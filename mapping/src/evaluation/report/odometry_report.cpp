#include <stillmap/mapping/odometry_evaluation.hpp>

#include "evaluation/report/odometry_figures.hpp"
#include "evaluation/report/page_parts.hpp"
#include "evaluation/report/report_page.hpp"
#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr std::string_view kOdometryStyle = R"(
.wide { max-width: 860px; } .truth { color: #9aa3ae; } svg .truth { stroke-width: 3.2; }
.loop { color: #e69f00; } svg .loop { stroke-width: 1.1; } .dot { fill: #e69f00; }
.wrongloop { color: #b3261e; } svg .wrongloop { stroke-width: 1.4; }
)";

/// Wrong loops that are listed, worst first.
constexpr std::size_t kListedLoops = 20;

std::string text_of(double value, int digits, std::string_view unit) {
  return std::isfinite(value) ? fmt::format("{:.{}f}\u202f{}", value, digits, unit) : "–";
}

/// Writes the page part by part, in the order in which it is read.
class OdometryPage : ReportPage {
 public:
  OdometryPage(const OdometryEvaluation& evaluation, const OdometryReportHeading& heading)
      : ReportPage("Odometry report", kOdometryStyle), evaluation_(evaluation), heading_(heading) {}

  [[nodiscard]] std::string page() {
    add_heading();
    add_tiles();
    add_figures();
    add_table();
    add_lengths();
    add_loops();
    add_times();
    return finished();
  }

 private:
  void add_heading() {
    const OdometryEvaluationOptions& options = evaluation_.options;
    std::string treated;
    if (options.movable != MovablePolicy::kKeep)
      treated = fmt::format(" · movable points <b>{}</b>, found by {}",
                            options.movable == MovablePolicy::kDelete ? "deleted" : "projected",
                            escaped(options.detector));
    add_title(fmt::format(
        "method <b>{}</b>{} · drive <b>{}</b> · {} "
        "scans, {:.0f} m{}",
        escaped(options.method), options.loops ? ", with loops" : ", without loops",
        escaped(heading_.drive), evaluation_.scans, evaluation_.odometry.way_m, treated));
  }

  void add_tiles() {
    const TrajectoryErrors& errors = evaluation_.errors();
    html_ +=
        "<div class=\"tiles\">" +
        tile_of(text_of(errors.kitti.translation_percent, 2, "%"), "KITTI translation") +
        tile_of(text_of(errors.kitti.rotation_deg_per_100m, 3, "deg"), "KITTI rotation in 100 m") +
        tile_of(text_of(errors.aligned_m.rmse, 2, "m"), "ATE, root mean square") +
        tile_of(text_of(errors.aligned_m.mean, 2, "m"), "APE, mean") +
        tile_of(text_of(errors.relative.translation_percent_10m, 2, "%"), "over 10 m");
    if (evaluation_.loops)
      html_ += tile_of(fmt::format("{} of {}", evaluation_.loops->right, evaluation_.loops->found),
                       "loops are right");
    html_ +=
        tile_of(fmt::format("{:.1f}", evaluation_.scans_per_second), "scans a second") + "</div>\n";
  }

  void add_figures() {
    html_ += "<h2>From above</h2>\n<p>" + key_of_style("truth", "truth, ") +
             key_of_style("c0", "odometry alone");
    if (evaluation_.corrected)
      html_ += ", " + key_of_style("c2", "with loops. ") + key_of_style("loop", "Loops, ") +
               key_of_style("wrongloop", "wrong ones");
    html_ +=
        ". Each path is laid onto the truth by the rigid motion that fits best.</p>\n"
        "<figure class=\"wide\">" +
        path_figure(evaluation_) + "</figure>\n<h2>Along the way</h2>\n<div class=\"row\">" +
        figure_of(aligned_figure(evaluation_), "Distance after the best rigid motion: APE, ATE") +
        figure_of(from_start_figure(evaluation_), "Distance with the first poses in common") +
        figure_of(height_figure(evaluation_), "Heights") + "</div>\n";
    if (evaluation_.odometry.kitti.segments == 0) return;
    html_ += "<h2>By length of segment</h2>\n<div class=\"row\">" +
             figure_of(translation_by_length_figure(evaluation_), "Translation") +
             figure_of(rotation_by_length_figure(evaluation_), "Rotation") + "</div>\n";
  }

  static std::string figure_of(const std::string& svg, std::string_view caption) {
    return fmt::format("<figure>{}<figcaption>{}</figcaption></figure>\n", svg, caption);
  }

  void add_row(const std::string& name, const TrajectoryErrors& errors) {
    html_ +=
        row_of({name, text_of(errors.kitti.translation_percent, 3, "%"),
                text_of(errors.kitti.rotation_deg_per_100m, 4, "deg"),
                text_of(errors.aligned_m.mean, 3, "m"), text_of(errors.aligned_m.rmse, 3, "m"),
                text_of(errors.aligned_m.max, 3, "m"), text_of(errors.from_start_m.rmse, 3, "m"),
                text_of(errors.relative.translation_percent_10m, 3, "%"),
                text_of(errors.relative.rotation_deg_10m, 4, "deg")});
  }

  void add_table() {
    html_ += "<h2>Errors</h2>\n<div class=\"scroll\"><table>" +
             row_of({"", "KITTI translation", "rotation in 100 m", "APE mean", "ATE rmse",
                     "farthest", "rmse from the start", "over 10 m", "turn in 10 m"},
                    "th");
    add_row(key_of_style("c0", "odometry alone"), evaluation_.odometry);
    if (evaluation_.corrected) add_row(key_of_style("c2", "with loops"), *evaluation_.corrected);
    html_ +=
        "</table></div>\n<p>APE and ATE are distances of positions after the rigid motion, "
        "without scale, that fits best; from the start, with nothing but the first poses in "
        "common. A dash: the drive is shorter than a segment.</p>\n";
    const RelativeErrors& relative = evaluation_.errors().relative;
    html_ += "<table class=\"narrow\">" +
             row_of({"from a scan to the next", "mean", "rmse", "largest"}, "th") +
             row_of({"translation", text_of(1e3 * relative.step_translation_m.mean, 1, "mm"),
                     text_of(1e3 * relative.step_translation_m.rmse, 1, "mm"),
                     text_of(1e3 * relative.step_translation_m.max, 1, "mm")}) +
             row_of({"rotation", text_of(relative.step_rotation_deg.mean, 4, "deg"),
                     text_of(relative.step_rotation_deg.rmse, 4, "deg"),
                     text_of(relative.step_rotation_deg.max, 4, "deg")}) +
             "</table>\n";
  }

  void add_lengths() {
    const auto& lengths = evaluation_.errors().kitti.lengths;
    if (lengths.empty()) return;
    html_ += "<h2>KITTI's segments</h2>\n<table class=\"narrow\">" +
             row_of({"length", "segments", "translation", "rotation in 100 m"}, "th");
    for (const LengthErrors& each : lengths)
      html_ += row_of({fmt::format("{:.0f}\u2009m", each.length_m), grouped_text(each.segments),
                       text_of(each.translation_percent, 3, "%"),
                       text_of(each.rotation_deg_per_100m, 4, "deg")});
    html_ += "</table>\n";
  }

  void add_loops() {
    if (!evaluation_.loops) return;
    const LoopScores& loops = *evaluation_.loops;
    html_ +=
        "<h2>Loops</h2>\n<p>A key frame is a revisit when an earlier one, 50 m of path or "
        "more before it, lies within 5 m, whatever the heading; found when a right loop ends "
        "within 5 m of path of it. Right is within 0.5 m and 2 deg of the truth.</p>\n"
        "<table class=\"narrow\">" +
        row_of({"loops", grouped_text(loops.found)}) +
        row_of({"precision",
                fmt::format("{} <small>{} of {}</small>", percent_text(loops.precision, 1),
                            grouped_text(loops.right), grouped_text(loops.found))}) +
        row_of({"recall",
                fmt::format("{} <small>{} of {}</small>", percent_text(loops.recall, 1),
                            grouped_text(loops.revisits_found), grouped_text(loops.revisits))}) +
        "</table>\n";
    add_wrong_loops(loops);
  }

  void add_wrong_loops(const LoopScores& loops) {
    std::vector<EvaluatedLoop> wrong;
    std::copy_if(loops.loops.begin(), loops.loops.end(), std::back_inserter(wrong),
                 [](const EvaluatedLoop& loop) { return !loop.right; });
    if (wrong.empty()) return;
    std::stable_sort(wrong.begin(), wrong.end(),
                     [](const EvaluatedLoop& a, const EvaluatedLoop& b) {
                       return a.translation_error_m > b.translation_error_m;
                     });
    html_ += "<table class=\"narrow\">" +
             row_of({"wrong, from scan", "to scan", "off by", "turned by", "believed"}, "th");
    for (std::size_t i = 0; i < std::min(kListedLoops, wrong.size()); ++i) {
      const EvaluatedLoop& loop = wrong[i];
      html_ += row_of({std::to_string(loop.from_scan), std::to_string(loop.to_scan),
                       text_of(loop.translation_error_m, 2, "m"),
                       text_of(loop.rotation_error_deg, 2, "deg"), percent_text(loop.weight, 1)});
    }
    html_ += "</table>\n";
  }

  void add_times() {
    const auto share = [&](std::size_t count) {
      return fmt::format(
          "{} <small>{}</small>", grouped_text(count),
          percent_text(static_cast<double>(count) / static_cast<double>(evaluation_.scans), 1));
    };
    html_ += "<h2>This evaluation</h2>\n<table class=\"narrow\">" +
             row_of({"scans matched", share(evaluation_.matched)}) +
             row_of({"partly, the rest predicted", share(evaluation_.partly)}) +
             row_of({"predicted", share(evaluation_.predicted)}) +
             row_of({"key frames", grouped_text(evaluation_.keyframes.size())}) +
             row_of({"odometry, with reading", text_of(evaluation_.odometry_seconds, 1, "s")});
    if (evaluation_.loops)
      html_ += row_of({"loops", text_of(evaluation_.loop_seconds, 1, "s")}) +
               row_of({"pose graph", text_of(evaluation_.graph_seconds, 2, "s")});
    if (evaluation_.options.movable != MovablePolicy::kKeep)
      html_ += row_of({"points projected, deleted",
                       fmt::format("{}, {} of {}", grouped_text(evaluation_.points.projected),
                                   grouped_text(evaluation_.points.deleted),
                                   grouped_text(evaluation_.points.in))});
    html_ += row_of({"in all", text_of(evaluation_.seconds, 1, "s")}) + "</table>\n<pre>" +
             escaped(heading_.command) + "</pre>\n";
  }

  const OdometryEvaluation& evaluation_;
  const OdometryReportHeading& heading_;
};

}  // namespace

std::string to_html(const OdometryEvaluation& evaluation, const OdometryReportHeading& heading) {
  return OdometryPage(evaluation, heading).page();
}

}  // namespace stillmap::mapping

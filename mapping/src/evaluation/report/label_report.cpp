#include <stillmap/mapping/label_evaluation.hpp>

#include "evaluation/report/page_parts.hpp"
#include "evaluation/report/report_page.hpp"
#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr std::string_view kLabelStyle = R"(
.views { display: grid; grid-template-columns: 1fr 1fr; gap: 14px; } .views img { width: 100%; border-radius: 6px; display: block; }
.views figcaption { padding: 4px 0 0; } @media (max-width: 800px) { .views { grid-template-columns: 1fr; } }
.pair { display: grid; grid-template-columns: 1fr 360px; gap: 24px; align-items: start; } .pair figure { width: 360px; max-width: 100%; }
@media (max-width: 800px) { .pair { grid-template-columns: 1fr; } }
.parked { color: #ff9628; } .moving { color: #5ac8ff; } .bar { display: inline-block; height: 9px; border-radius: 2px; background: #d55e00; vertical-align: 0; }
td.left { text-align: left; width: 30%; }
)";

std::string centimetres(double metres) {
  return std::isnan(metres) ? "–" : fmt::format("{:.1f} cm", 100.0 * metres);
}

std::string counted_share(const Share& share, int digits = 2) {
  if (share.of == 0) return "–";
  return fmt::format("{}<br><small>{} of {}</small>", percent_text(share.rate(), digits),
                     grouped_text(share.count), grouped_text(share.of));
}

/// Writes the page part by part, in the order in which it is read.
class LabelPage : ReportPage {
 public:
  LabelPage(const LabelEvaluation& evaluation, const LabelReportHeading& heading)
      : ReportPage("Map report", kLabelStyle), evaluation_(evaluation), heading_(heading) {}

  [[nodiscard]] std::string page() {
    add_heading();
    add_tiles();
    add_views();
    add_scores();
    add_losses();
    add_ground_under_objects();
    add_ground();
    add_times();
    return finished();
  }

 private:
  [[nodiscard]] std::string kind() const {
    return evaluation_.unthinned ? "unthinned map" : "thinned map";
  }

  void add_heading() {
    add_title(
        fmt::format("map <b>{}</b> · truth <b>{}</b> · {} scans, {} "
                    "points · truth classes <b>{}</b>",
                    escaped(heading_.map), escaped(heading_.drive), evaluation_.scans,
                    grouped_text(evaluation_.points), name_of(heading_.classes)));
    if (!evaluation_.drive_in_map) {
      html_ +=
          "<p>The map was not made of this drive: its package is judged as it is, all scans of the "
          "drive count, and what was out of the map's sight counts as lost.</p>\n";
    }
  }

  void add_tiles() {
    const MapFigures& figures = evaluation_.figures();
    const MapScores& scores = figures.of(heading_.classes);
    html_ +=
        "<div class=\"tiles\">" +
        tile_of(percent_text(figures.parked_removed.rate()), "of parked objects' points removed") +
        tile_of(percent_text(scores.static_loss, 3), "of what stays lost") +
        tile_of(percent_text(scores.DA), "DA, projected points not matched") +
        tile_of(percent_text(figures.ground_under.filled.rate(), 1),
                "ground complete under objects") +
        tile_of(evaluation_.ground ? percent_text(evaluation_.ground->f1()) : "–",
                "F1 of ground points") +
        "</div>\n";
  }

  void add_views() {
    if (!evaluation_.pictures) return;
    html_ += fmt::format(
        "<h2>Before and after</h2>\n<p>From above, coloured by height. Removed objects: <span "
        "class=\"key parked\"></span>{} parked, <span class=\"key moving\"></span>{} moving with "
        "their paths.</p>\n<div class=\"views\">",
        evaluation_.parked_objects, evaluation_.moving_objects);
    html_ += picture_of(evaluation_.pictures->before_png, "As measured, all scans") +
             picture_of(evaluation_.pictures->after_png, "The map") + "</div>\n";
  }

  /// A line for both sets of classes on both kinds of map.
  template <typename Value>
  void add_score(const std::string& name, const Value& value) {
    std::string line = "<tr><td>" + name + "</td>";
    for (const TruthClasses classes : {TruthClasses::kMovable, TruthClasses::kMoving}) {
      if (evaluation_.unthinned)
        line += "<td>" + value(evaluation_.unthinned->of(classes)) + "</td>";
      line += "<td>" + value(evaluation_.thinned.of(classes)) + "</td>";
    }
    html_ += line + "</tr>\n";
  }

  void add_scores() {
    html_ += "<h2>Scores</h2>\n<div class=\"scroll\"><table>";
    html_ +=
        evaluation_.unthinned
            ? row_of({"", "movable, unthinned", "thinned", "moving, unthinned", "thinned"}, "th")
            : row_of({"", "movable, thinned", "moving, thinned"}, "th");
    add_score("SA", [](const MapScores& s) { return counted_share(s.static_kept); });
    add_score("DA", [](const MapScores& s) { return counted_share(s.dynamic_removed); });
    add_score("DA with projected and filled points",
              [](const MapScores& s) { return counted_share(s.plain_removed); });
    add_score("AA", [](const MapScores& s) { return percent_text(s.AA); });
    add_score("HA", [](const MapScores& s) { return percent_text(s.HA); });
    add_score("PR", [](const MapScores& s) { return counted_share(s.static_voxels_kept); });
    add_score("RR", [](const MapScores& s) { return percent_text(s.RR); });
    add_score("F1", [](const MapScores& s) { return percent_text(s.F1); });
    add_score("static points lost",
              [](const MapScores& s) { return counted_share(s.static_lost, 3); });
    add_score("the same, nothing removed", [](const MapScores& s) {
      return s.static_lost_uncleaned.of == 0 ? "0"
                                             : percent_text(s.static_lost_uncleaned.rate(), 3);
    });
    add_score("<b>static loss</b>",
              [](const MapScores& s) { return percent_text(s.static_loss, 3); });
    html_ +=
        "</table></div>\n<p>SA, DA: truth within 50 m of the sensor, a map point within 5 cm; for "
        "DA projected and filled points are not matched. PR, RR: voxels of 0.2 m. Static loss: no "
        "measured map point within 10 cm, less the same for the map of such voxels that holds "
        "everything.</p>\n";
  }

  void add_losses() {
    const std::vector<ClassLoss>& losses = evaluation_.figures().losses;
    double most = 1e-4;
    for (const ClassLoss& loss : losses) most = std::max(most, loss.loss);
    html_ += fmt::format("<h2>Static loss by class</h2>\n<p>On the {}.</p>\n<table>", kind());
    html_ += row_of({"class", "points", "lost", "static loss", "thinned", ""}, "th");
    for (std::size_t i = 0; i < losses.size(); ++i) {
      const ClassLoss& loss = losses[i];
      html_ += fmt::format(
          "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"left\"><span "
          "class=\"bar\" style=\"width:{:.1f}%\"></span></td></tr>\n",
          escaped(loss.name), grouped_text(loss.lost.of), grouped_text(loss.lost.count),
          percent_text(loss.loss, 3), percent_text(evaluation_.thinned.losses.at(i).loss, 3),
          100.0 * std::max(0.0, loss.loss) / most);
    }
    html_ += "</table>\n";
  }

  static std::string heights_row(const std::string& name, const HeightErrors& errors) {
    return row_of({name, grouped_text(errors.points), centimetres(errors.median_m),
                   centimetres(errors.p95_m)});
  }

  static std::string ground_row(const std::string& name, const GroundUnder& ground) {
    return row_of({name, grouped_text(ground.filled.of), percent_text(ground.projected.rate(), 1),
                   percent_text(ground.filled.rate(), 1), grouped_text(ground.wrong)});
  }

  [[nodiscard]] std::string heights_figure(const GroundHeights& heights) const {
    SvgPlot plot({.label = "height error [cm]", .max = 20.0},
                 {.label = "share of points [%]", .max = 100.0});
    for (const double mark : {3.0, 6.0, 12.0}) plot.add_vertical(mark, "mark");
    const auto curve = [&plot](const HeightErrors& errors, std::string_view style) {
      std::vector<SvgPlot::Point> points;
      for (std::size_t i = 0; i < errors.percentiles_m.size(); ++i)
        points.emplace_back(100.0 * errors.percentiles_m[i], static_cast<double>(i));
      if (!points.empty()) plot.add_line(points, style);
    };
    curve(heights.one_surface, "c0");
    curve(heights.across_kerb, "c1");
    return plot.svg("Distribution of the height error");
  }

  void add_ground_under_objects() {
    html_ += "<h2>Ground under removed objects</h2>\n";
    if (evaluation_.true_ground != TrueGround::kSurface) {
      html_ += "<p>No true ground: the drive has no truth/ground.ply.</p>\n";
      return;
    }
    const GroundHeights& heights = *evaluation_.heights;
    const MapFigures& figures = evaluation_.figures();
    html_ += "<div class=\"pair\"><div><table>" +
             row_of({"footprints from the path", "cells of 0.25 m", "measured and projected",
                     "with filled points", "at a wrong height"},
                    "th");
    double from_m = 0.0;
    for (const GroundUnderBand& band : figures.ground_bands) {
      html_ +=
          ground_row(std::isfinite(band.to_m) ? fmt::format("{:g} to {:g} m", from_m, band.to_m)
                                              : fmt::format("beyond {:g} m", from_m),
                     band.ground);
      from_m = band.to_m;
    }
    html_ += ground_row("<b>all</b>", figures.ground_under) + "</table>\n<table>" +
             row_of({"height error", "points", "median", "95 %"}, "th") +
             heights_row("projected and filled", heights.all) +
             heights_row("projected", heights.projected) + heights_row("filled", heights.filled) +
             heights_row("<span class=\"key c0\"></span>on one surface", heights.one_surface) +
             heights_row("<span class=\"key c1\"></span>across a kerb", heights.across_kerb) +
             "</table>\n<p>Complete: a ground point within 5 cm of the true height. Footprints of "
             "parked objects; heights within 25 m of the path.</p></div>\n<figure>" +
             heights_figure(heights) +
             "<figcaption>Share of points that are off by less; dashed: 3, 6 and 12 "
             "cm</figcaption></figure></div>\n";
  }

  void add_ground() {
    if (!evaluation_.ground) return;
    const GroundScores& ground = *evaluation_.ground;
    html_ += "<h2>Ground points</h2>\n<table class=\"narrow\">" +
             row_of({"precision", "recall", "F1", "found", "wrong", "missed"}, "th") +
             row_of({percent_text(ground.precision()), percent_text(ground.recall()),
                     percent_text(ground.f1()), grouped_text(ground.true_positives),
                     grouped_text(ground.false_positives), grouped_text(ground.false_negatives)}) +
             "</table>\n<p>Road, parking, pavement, other ground, lane marking and terrain are "
             "ground; vegetation and unlabelled points are left out.</p>\n";
  }

  void add_times() {
    html_ += "<h2>This evaluation</h2>\n<table class=\"narrow\">";
    for (const auto& [stage, seconds] : evaluation_.stage_seconds)
      html_ += row_of({stage, fmt::format("{:.1f} s", seconds)});
    html_ += row_of({"in all", fmt::format("{:.1f} s", evaluation_.seconds)}) +
             row_of({"peak memory", fmt::format("{:.0f} MiB", evaluation_.peak_rss_mib)}) +
             row_of({"points of no known class", grouped_text(evaluation_.ignored)}) +
             row_of({"points that the build dropped", grouped_text(evaluation_.dropped)}) +
             "</table>\n<pre>" + escaped(heading_.command) + "</pre>\n";
  }

  const LabelEvaluation& evaluation_;
  const LabelReportHeading& heading_;
};

}  // namespace

std::string to_html(const LabelEvaluation& evaluation, const LabelReportHeading& heading) {
  return LabelPage(evaluation, heading).page();
}

}  // namespace stillmap::mapping

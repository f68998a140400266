#include <stillmap/mapping/localization_report.hpp>

#include "evaluation/localization/localization_metrics.hpp"
#include "evaluation/report/figures.hpp"
#include "evaluation/report/page_parts.hpp"
#include "evaluation/report/report_page.hpp"
#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <cmath>
#include <initializer_list>
#include <set>

namespace stillmap::mapping {
namespace {

/// A rate that should be zero, with its count and bound.
std::string rare(const BoundedRate& rate) {
  if (rate.of == 0) return "–";
  return fmt::format("<span{}>{}</span> of {} <small>&lt; {:.2g} %</small>",
                     rate.count > 0 ? " class=\"bad\"" : "", rate.count, rate.of,
                     100.0 * rate.upper_95);
}

std::string figure(const std::string& svg, std::string_view caption) {
  return fmt::format("<figure>{}<figcaption>{}</figcaption></figure>\n", svg, caption);
}

/// Writes the page part by part, in the order in which it is read.
class LocalizationPage : ReportPage {
 public:
  explicit LocalizationPage(const LocalizationEvaluation& evaluation)
      : ReportPage("Localization report"), evaluation_(evaluation) {}

  [[nodiscard]] std::string page(const LocalizationReportHeading& heading) {
    add_heading(heading);
    add_levels();
    add_errors();
    add_integrity();
    add_calibration();
    add_times();
    add_status();
    add_options(heading);
    return finished();
  }

 private:
  [[nodiscard]] std::string title_of(std::size_t level) const {
    return fmt::format("<span class=\"key {}\"></span>{}", style_of_level(level),
                       name_of(evaluation_.levels[level], evaluation_.options.prior));
  }

  void add_heading(const LocalizationReportHeading& heading) {
    std::size_t queries = 0;
    for (const LocalizationLevel& level : evaluation_.levels) queries += level.queries;
    add_title(
        fmt::format("map <b>{}</b> · drive <b>{}</b> · "
                    "method <b>{}</b> · {} queries on {} scans",
                    escaped(heading.map), escaped(heading.drive), escaped(heading.method), queries,
                    evaluation_.scans));
  }

  void add_levels() {
    html_ +=
        "<div class=\"scroll\"><table>" +
        row_of({"prior off by", "queries", "success", "95 % interval", "false ok", "error, median",
                "95 %", "rmse x-y", "turn, median", "95 %", "rmse yaw", "CPU, median", "95 %"},
               "th");
    for (std::size_t i = 0; i < evaluation_.levels.size(); ++i) {
      const LocalizationLevel& level = evaluation_.levels[i];
      const std::string false_ok = percent_text(level.false_ok_rate);
      html_ += row_of(
          {title_of(i), fmt::format("{}", level.queries), percent_text(level.success_rate),
           percent_text(level.success_interval[0], 1) + " to " +
               percent_text(level.success_interval[1], 1),
           level.false_ok_rate > 0.0 ? "<span class=\"bad\">" + false_ok + "</span>" : false_ok,
           number_text(100.0 * level.translation_m.median, 1) + " cm",
           number_text(100.0 * level.translation_m.p95, 1) + " cm",
           number_text(100.0 * level.translation_m.rmse_part, 1) + " cm",
           number_text(level.rotation_deg.median, 2) + "°",
           number_text(level.rotation_deg.p95, 2) + "°",
           number_text(level.rotation_deg.rmse_part, 2) + "°",
           number_text(level.cpu_ms.p50, 1) + " ms", number_text(level.cpu_ms.p95, 1) + " ms"});
    }
    html_ +=
        "</table></div>\n<p>Success: not lost, and within 0.2 m and 1°. False ok: ok, but off by "
        "more than 0.5 m or 2°. Intervals by resampling whole scans.</p>\n";
  }

  void add_errors() {
    html_ +=
        "<h2>Success and errors</h2>\n<p>Curves count all queries, so one that was lost "
        "keeps them below 100 %. Dashed: the limits of success.</p>\n<div class=\"row\">" +
        figure(success_figure(evaluation_), "Bars with their 95 % intervals") +
        figure(translation_figure(evaluation_), "Share of queries that are off by less") +
        figure(yaw_figure(evaluation_), "Share of queries that are off by less") + "</div>\n";
  }

  void add_integrity() {
    html_ +=
        "<h2>Integrity</h2>\n<p>Protection level against true error of the answers that are ok "
        "(Stanford diagram). Below the diagonal the error is beyond its level: misleading, in "
        "red. The dashed line is the alert limit of street driving, 0.29 m and 0.5°.</p>\n"
        "<div class=\"scroll\"><table>" +
        row_of({"prior off by", "misleading", "hazardous", "available", "95 % bounds",
                "median of level over error"},
               "th");
    for (std::size_t i = 0; i < evaluation_.levels.size(); ++i) {
      const Integrity& integrity = evaluation_.levels[i].integrity;
      html_ += row_of({title_of(i), rare(integrity.misleading), rare(integrity.hazardous),
                       percent_text(integrity.availability.rate, 1),
                       percent_text(integrity.availability_lower_95, 1) + " to " +
                           percent_text(integrity.availability.upper_95, 1),
                       number_text(integrity.level_over_error, 1)});
    }
    html_ += "</table></div>\n";
    for (std::size_t i = 0; i < evaluation_.levels.size(); ++i) {
      html_ += "<div class=\"row\">";
      for (const Axis axis : {Axis::kLongitudinal, Axis::kLateral, Axis::kYaw})
        html_ += figure(stanford_figure(evaluation_.queries[i], axis), title_of(i));
      html_ += "</div>\n";
    }
  }

  void add_calibration() {
    html_ +=
        "<h2>Calibration of the covariance</h2>\n<p>NEES is the squared error in units of the "
        "covariance. Honest covariances follow the line, chi-squared with 6 degrees of freedom: "
        "mean 6, 95 % below 12.59 (dashed). Left of it they are too large, right of it too small. "
        "Answers that are not lost.</p>\n<div class=\"row\">";
    for (std::size_t i = 0; i < evaluation_.levels.size(); ++i) {
      const LocalizationLevel& level = evaluation_.levels[i];
      html_ += figure(
          nees_figure(evaluation_.queries[i]),
          fmt::format("{}: mean {}, {} below 12.59", title_of(i), number_text(level.nees_mean, 2),
                      percent_text(level.nees_inside_95, 1)));
    }
    html_ += "</div>\n";
  }

  void add_times() {
    html_ +=
        "<h2>Times</h2>\n<p>Of one query, thinning included, reading and deskewing not.</p>\n"
        "<div class=\"row\">" +
        figure(latency_figure(evaluation_), "Share of queries that took less") +
        "<div style=\"grid-column: span 2\" class=\"scroll\"><table>" +
        row_of({"prior off by", "ms", "50 %", "90 %", "95 %", "99 %", "most"}, "th");
    for (std::size_t i = 0; i < evaluation_.levels.size(); ++i) {
      std::vector<double> cpu, wall;
      for (const LocalizationQuery& query : evaluation_.queries[i]) {
        cpu.push_back(query.cpu_ms);
        wall.push_back(query.wall_ms);
      }
      for (const auto& [name, times] : {std::pair{"CPU", cpu}, std::pair{"wall", wall}}) {
        html_ += row_of(
            {title_of(i), name, number_text(percentile(times, 0.5), 1),
             number_text(percentile(times, 0.9), 1), number_text(percentile(times, 0.95), 1),
             number_text(percentile(times, 0.99), 1), number_text(percentile(times, 1.0), 1)});
      }
    }
    html_ += "</table></div></div>\n";
  }

  void add_status() {
    html_ += "<h2>Status and reasons</h2>\n<div class=\"scroll\"><table class=\"narrow\">";
    std::string head = "<tr><th></th>";
    std::string strips = "<tr><td></td>";
    std::set<localization::Reason> reasons;
    for (std::size_t i = 0; i < evaluation_.levels.size(); ++i) {
      const LocalizationLevel& level = evaluation_.levels[i];
      head += "<th>" + title_of(i) + "</th>";
      strips += fmt::format(
          "<td><div class=\"strip\"><i class=\"ok\" style=\"flex:{}\"></i><i class=\"degraded\" "
          "style=\"flex:{}\"></i><i class=\"lost\" style=\"flex:{}\"></i></div></td>",
          level.ok, level.degraded, level.lost);
      for (const auto& [reason, count] : level.reasons) reasons.insert(reason);
    }
    html_ += head + "</tr>\n" + strips + "</tr>\n";
    add_counts("<b>ok</b>", [](const LocalizationLevel& level) { return level.ok; });
    add_counts("<b>degraded</b>", [](const LocalizationLevel& level) { return level.degraded; });
    add_counts("<b>lost</b>", [](const LocalizationLevel& level) { return level.lost; });
    for (const localization::Reason reason : reasons) {
      add_counts(localization::name_of(reason), [&](const LocalizationLevel& level) {
        const auto found = level.reasons.find(reason);
        return found == level.reasons.end() ? std::size_t{0} : found->second;
      });
    }
    html_ += "</table></div>\n<p>An answer may have several reasons.</p>\n";
  }

  template <typename Count>
  void add_counts(std::string_view name, const Count& count) {
    html_ += fmt::format("<tr><td>{}</td>", name);
    for (const LocalizationLevel& level : evaluation_.levels)
      html_ += fmt::format("<td>{}</td>", count(level));
    html_ += "</tr>\n";
  }

  void add_options(const LocalizationReportHeading& heading) {
    const LocalizationEvaluationOptions& options = evaluation_.options;
    const maps::Selection& selection = options.selection;
    html_ += "<h2>Options</h2>\n<table class=\"narrow\">";
    html_ += row_of({"scans", fmt::format("{}:{}:{}", selection.begin,
                                          selection.end ? std::to_string(*selection.end) : "",
                                          selection.step)});
    html_ += row_of({"prior", std::string(name_of(options.prior))});
    html_ += row_of({"bias", std::string(name_of(options.bias))});
    html_ += row_of({"queries deskewed by", std::string(name_of(options.query_deskew))});
    html_ += row_of({"movable objects in queries", std::string(name_of(options.query_movable))});
    if (options.query_movable != MovablePolicy::kKeep)
      html_ += row_of({"found by", escaped(options.query_detector)});
    html_ += row_of({"trials", std::to_string(options.trials)});
    html_ += row_of({"seed", std::to_string(options.seed)});
    html_ += row_of({"threads", std::to_string(options.threads)});
    html_ += row_of({"took", number_text(evaluation_.seconds, 1) + " s"});
    html_ += "</table>\n<pre>" + escaped(heading.command) + "</pre>\n";
  }

  const LocalizationEvaluation& evaluation_;
};

}  // namespace

std::string to_html(const LocalizationEvaluation& evaluation,
                    const LocalizationReportHeading& heading) {
  return LocalizationPage(evaluation).page(heading);
}

}  // namespace stillmap::mapping

#include <stillmap/mapping/paper_evaluation.hpp>

#include "evaluation/paper/paper_figures.hpp"
#include "evaluation/report/page_parts.hpp"
#include "evaluation/report/report_page.hpp"
#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <numbers>

namespace stillmap::mapping {
namespace {

constexpr double kCentimetres = 100.0;
constexpr double kDegrees = 180.0 / std::numbers::pi;

std::string text_of(const Interval& interval, double scale, int digits) {
  return fmt::format(
      "<b>{}</b> <small>{} to {}</small>", number_text(scale * interval.value, digits),
      number_text(scale * interval.low, digits), number_text(scale * interval.high, digits));
}

/// Green where all of the interval is below zero, red where all of it is above.
std::string difference_text(const Interval& interval, double scale, int digits) {
  const bool worse = interval.low > 0.0;
  const bool better = interval.high < 0.0;
  return fmt::format("<span class=\"{}\">{:+.{}f}</span> <small>{:+.{}f} to {:+.{}f}</small>",
                     worse    ? "bad"
                     : better ? "good"
                              : "",
                     scale * interval.value, digits, scale * interval.low, digits,
                     scale * interval.high, digits);
}

/// Bars with their intervals, a map each.
std::string bars(const std::vector<const PaperRow*>& rows, const std::string& label, double scale,
                 const std::function<const Interval&(const PaperRow&)>& figure) {
  PlotAxis x{.label = "map", .max = static_cast<double>(rows.size())};
  PlotAxis y{.label = label, .max = 0.0};
  for (const PaperRow* row : rows) {
    x.categories.push_back(row->map);
    const Interval& interval = figure(*row);
    const double top = std::isfinite(interval.high) ? interval.high : interval.value;
    y.max = std::max(y.max, scale * top * kHeadroom);
  }
  // All errors are zero: an axis must still have a length.
  if (!(y.max > 0.0)) y.max = 1.0;
  SvgPlot plot(x, y);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Interval& interval = figure(*rows[i]);
    const double middle = static_cast<double>(i) + 0.5;
    const bool ours = rows[i]->map.starts_with("ours");
    plot.add_box({middle - 0.3, 0.0}, {middle + 0.3, scale * interval.value},
                 ours ? "fill c2" : "fill c0", 0.75);
    if (std::isfinite(interval.low) && std::isfinite(interval.high))
      plot.add_line({{middle, scale * interval.low}, {middle, scale * interval.high}}, "whisker");
  }
  return plot.svg(label);
}

/// Writes the page part by part, in the order in which it is read.
class PaperPage : ReportPage {
 public:
  explicit PaperPage(const PaperEvaluation& evaluation)
      : ReportPage("The paper's Table II"), evaluation_(evaluation) {}

  [[nodiscard]] std::string page(const std::string& command) {
    add_heading();
    for (const PaperRow& row : evaluation_.rows) {
      const std::vector<const PaperRow*> rows = rows_like(row);
      if (rows.front() == &row) add_block(rows);
    }
    add_differences();
    add_streets();
    add_command(command);
    return finished();
  }

 private:
  [[nodiscard]] std::vector<const PaperRow*> rows_like(const PaperRow& like) const {
    std::vector<const PaperRow*> rows;
    for (const PaperRow& row : evaluation_.rows) {
      if (row.method == like.method && row.query == like.query) rows.push_back(&row);
    }
    return rows;
  }

  static std::string title_of(const std::string& method, const std::string& query) {
    return fmt::format("{}, scans {}", escaped(method),
                       query == "raw" ? "as they are" : "without movable objects");
  }

  void add_heading() {
    std::string streets;
    for (const std::string& street : evaluation_.streets)
      streets += (streets.empty() ? "" : ", ") + escaped(street);
    add_title(fmt::format(
        "{} · sensor <b>{}</b> · objects "
        "found by <b>{}</b> · {} scans asked for",
        streets, evaluation_.options.drives.empty() ? escaped(evaluation_.options.sensor) : "given",
        escaped(evaluation_.options.detector), evaluation_.scans));
    html_ +=
        "<p>Maps are made of day 1, scans of day 2 are asked for from the true pose of the scan "
        "before. RMSE of x-y and of yaw over all scans; an answer that is lost counts with its "
        "prior's error. 95 % intervals by drawing streets, and blocks of 10 scans in them, with "
        "Student's factor for that many streets.</p>\n";
  }

  void add_block(const std::vector<const PaperRow*>& rows) {
    html_ += fmt::format("<h2>{}</h2>\n<div class=\"scroll\"><table>",
                         title_of(rows.front()->method, rows.front()->query));
    html_ += row_of({"map", "rmse x-y [cm]", "rmse yaw [mrad]", "[deg]", "success [%]", "degraded",
                     "lost", "of", "answered: x-y [cm]", "yaw [deg]"},
                    "th");
    for (const PaperRow* row : rows) {
      html_ += row_of({escaped(row->map), text_of(row->rmse_xy_m, kCentimetres, 2),
                       text_of(row->rmse_yaw_rad, 1e3, 2),
                       number_text(row->rmse_yaw_rad.value * kDegrees, 3),
                       text_of(row->success_rate, 100.0, 1), std::to_string(row->degraded),
                       std::to_string(row->lost), std::to_string(row->queries),
                       number_text(kCentimetres * row->answered_rmse_xy_m, 2),
                       number_text(row->answered_rmse_yaw_rad * kDegrees, 3)});
    }
    html_ += "</table></div>\n<div class=\"row\" style=\"grid-template-columns: 1fr 1fr\">";
    html_ += "<figure>" +
             bars(rows, "rmse x-y [cm]", kCentimetres,
                  [](const PaperRow& row) -> const Interval& { return row.rmse_xy_m; }) +
             "</figure><figure>" +
             bars(rows, "rmse yaw [mrad]", 1e3,
                  [](const PaperRow& row) -> const Interval& { return row.rmse_yaw_rad; }) +
             "</figure></div>\n";
  }

  void add_differences() {
    if (evaluation_.differences.empty()) return;
    html_ +=
        "<h2>Differences</h2>\n<p>Of the same scans from the same priors. Below zero the first "
        "map is better. In colour where the whole interval is on one side of zero.</p>\n"
        "<div class=\"scroll\"><table>" +
        row_of({"method and scans", "map", "less map", "rmse x-y [cm]", "better in streets",
                "rmse yaw [mrad]", "better in streets"},
               "th");
    for (const PaperDifference& each : evaluation_.differences)
      html_ += row_of({title_of(each.method, each.query), escaped(each.map), escaped(each.against),
                       difference_text(each.rmse_xy_m, kCentimetres, 2),
                       fmt::format("{} of {}", each.better_xy, each.streets),
                       difference_text(each.rmse_yaw_rad, 1e3, 2),
                       fmt::format("{} of {}", each.better_yaw, each.streets)});
    html_ += "</table></div>\n";
  }

  void add_streets() {
    html_ += "<h2>Streets</h2>\n<div class=\"scroll\"><table>";
    html_ += "<tr><th>method and scans</th><th>map</th>";
    for (const std::string& street : evaluation_.streets)
      html_ += fmt::format("<th>{}: x-y [cm]</th><th>yaw [mrad]</th>", escaped(street));
    html_ += "</tr>\n";
    for (const PaperRow& row : evaluation_.rows) {
      html_ += fmt::format("<tr><td>{}</td><td>{}</td>", title_of(row.method, row.query),
                           escaped(row.map));
      for (const PaperAnswers& street : row.streets)
        html_ += fmt::format("<td>{}</td><td>{}</td>",
                             number_text(kCentimetres * street_rmse_xy_m(street), 2),
                             number_text(1e3 * street_rmse_yaw_rad(street), 2));
      html_ += "</tr>\n";
    }
    html_ += "</table></div>\n";
  }

  const PaperEvaluation& evaluation_;
};

}  // namespace

std::string to_html(const PaperEvaluation& evaluation, const std::string& command) {
  return PaperPage(evaluation).page(command);
}

}  // namespace stillmap::mapping

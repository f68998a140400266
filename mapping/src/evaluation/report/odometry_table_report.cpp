#include <stillmap/mapping/odometry_table.hpp>

#include "evaluation/report/page_parts.hpp"
#include "evaluation/report/report_page.hpp"
#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

std::string drives_text(std::size_t drives) {
  return fmt::format("{} {}", drives, drives == 1 ? "drive" : "drives");
}

/// Green where all of the interval is below zero, red where all of it is above.
std::string difference_text(const Interval& interval, int digits) {
  if (!std::isfinite(interval.value)) return "–";
  std::string_view style;
  if (interval.low > 0.0) style = "bad";
  if (interval.high < 0.0) style = "good";
  std::string value =
      fmt::format("<span class=\"{}\">{:+.{}f}</span>", style, interval.value, digits);
  if (!std::isfinite(interval.low)) return value;
  return fmt::format("{} <small>{:+.{}f} to {:+.{}f}</small>", value, interval.low, digits,
                     interval.high, digits);
}

std::string style_of(MovablePolicy points) {
  switch (points) {
    case MovablePolicy::kProject:
      return "c2";
    case MovablePolicy::kDelete:
      return "c1";
    case MovablePolicy::kKeep:
      break;
  }
  return "c0";
}

const PathFigures& figures_of(const OdometryTableRun& run, bool loops) {
  return loops ? run.with_loops : run.without_loops;
}

/// Writes the page part by part, in the order in which it is read.
class OdometryTablePage : ReportPage {
 public:
  explicit OdometryTablePage(const OdometryTable& table)
      : ReportPage("The paper's Table I"), table_(table) {}

  [[nodiscard]] std::string page(const std::string& command) {
    add_heading();
    add_bars();
    for (const OdometryTableDrive& drive : table_.drives) add_drive(drive);
    add_differences();
    add_command(command);
    return finished();
  }

 private:
  void add_heading() {
    add_title(fmt::format("{} · objects found by <b>{}</b>", drives_text(table_.drives.size()),
                          escaped(table_.options.detector)));
    html_ +=
        "<p>Each drive is followed with its scans as they are, with movable "
        "points projected to the scan's mean ground height and with them deleted, each scan on its "
        "own as the paper does it. APE is the mean distance, ATE the root mean square, after the "
        "rigid motion without scale that fits best; the paper prints a mean in metres and does not "
        "say how paths were laid upon each other. Given poses are the truth here, so their row has "
        "no error.</p>\n";
    if (table_.missing.empty()) return;
    html_ += "<p>Sequences that the folder does not hold: ";
    for (std::size_t i = 0; i < table_.missing.size(); ++i)
      html_ += (i == 0 ? "" : ", ") + escaped(table_.missing[i]);
    html_ += ".</p>\n";
  }

  /// One drawing a method and loops: a group of bars a drive.
  [[nodiscard]] std::string bars(const std::string& method, bool loops) const {
    PlotAxis x{.label = "drive", .max = static_cast<double>(table_.drives.size())};
    double most_m = 0.0;
    for (const OdometryTableDrive& drive : table_.drives) x.categories.push_back(drive.name);
    for (const OdometryTableRun& run : table_.runs) {
      if (run.method == method) most_m = std::max(most_m, figures_of(run, loops).ape_mean_m);
    }
    const bool centimetres = most_m < 1.0;
    const double scale = centimetres ? 100.0 : 1.0;
    const PlotAxis y{.label = centimetres ? "mean APE [cm]" : "mean APE [m]",
                     .max = most_m > 0.0 ? kHeadroom * scale * most_m : 1.0};
    SvgPlot plot(x, y);
    for (const OdometryTableRun& run : table_.runs) {
      if (run.method != method) continue;
      double place = run.points == MovablePolicy::kKeep      ? 0.14
                     : run.points == MovablePolicy::kProject ? 0.39
                                                             : 0.64;
      for (const OdometryTableDrive& drive : table_.drives) {
        if (drive.name == run.drive) break;
        place += 1.0;
      }
      plot.add_box({place, 0.0}, {place + 0.22, scale * figures_of(run, loops).ape_mean_m},
                   "fill " + style_of(run.points), 0.8);
    }
    return plot.svg("Mean APE by drive");
  }

  void add_bars() {
    html_ += "<h2>Mean APE</h2>\n<p>";
    for (const MovablePolicy points :
         {MovablePolicy::kKeep, MovablePolicy::kProject, MovablePolicy::kDelete})
      html_ += fmt::format("<span class=\"key {}\"></span>{} &nbsp; ", style_of(points),
                           points_name(points));
    html_ += "</p>\n<div class=\"row\">";
    for (const std::string& method : table_.options.methods) {
      for (const bool loops : {false, true})
        html_ += fmt::format("<figure>{}<figcaption>{}, {} loops</figcaption></figure>\n",
                             bars(method, loops), escaped(method), loops ? "with" : "without");
    }
    html_ += "</div>\n";
  }

  void add_path(const OdometryTableRun& run, bool loops) {
    const PathFigures& figures = figures_of(run, loops);
    html_ += row_of({escaped(run.method), points_name(run.points), loops ? "on" : "off",
                     "<b>" + number_text(figures.ape_mean_m, 3) + "</b>",
                     number_text(figures.ate_rmse_m, 3), number_text(figures.kitti_percent, 3),
                     number_text(figures.kitti_deg_per_100m, 4),
                     number_text(figures.percent_10m, 3), number_text(figures.deg_10m, 4),
                     loops ? fmt::format("{} of {}", run.loops_right, run.loops_found) : "",
                     loops ? fmt::format("{} of {}", run.revisits_found, run.revisits) : ""});
  }

  void add_drive(const OdometryTableDrive& drive) {
    html_ += fmt::format("<h2>{}</h2>\n<p>{} scans, {:.0f} m.", escaped(drive.name),
                         grouped_text(drive.scans), drive.way_m);
    if (drive.paper_m)
      html_ += fmt::format(" The paper prints {:.2f} m without removal, {:.2f} m for its method.",
                           drive.paper_m->at(0), drive.paper_m->at(1));
    html_ += "</p>\n<div class=\"scroll\"><table>" +
             row_of({"odometry", "points", "loops", "APE [m]", "ATE [m]", "KITTI [%]",
                     "[deg/100 m]", "10 m [%]", "[deg]", "loops right", "revisits found"},
                    "th") +
             row_of({"given poses", "", "", "<b>0.000</b>", "0.000", "0.000", "0.0000", "0.000",
                     "0.0000", "", ""});
    for (const OdometryTableRun& run : table_.runs) {
      if (run.drive != drive.name) continue;
      add_path(run, false);
      add_path(run, true);
    }
    html_ += "</table></div>\n";
  }

  void add_differences() {
    html_ += fmt::format(
        "<h2>Against raw points</h2>\n<p>Below zero is better. Means over {} with Student's "
        "95 % interval.{}</p>\n<div class=\"scroll\"><table>",
        drives_text(table_.drives.size()),
        table_.drives.size() < 3 ? " So few drives say little of others." : "");
    html_ += row_of({"odometry", "points", "loops", "APE [m]", "10 m [%]", "better in"}, "th");
    for (const OdometryTableDifference& each : table_.differences)
      html_ += row_of({escaped(each.method), points_name(each.points) + " − raw",
                       each.loops ? "on" : "off", difference_text(each.ape_mean_m, 3),
                       difference_text(each.percent_10m, 3),
                       fmt::format("{} of {}", each.better, each.drives)});
    html_ += "</table></div>\n";
  }

  const OdometryTable& table_;
};

}  // namespace

std::string to_html(const OdometryTable& table, const std::string& command) {
  return OdometryTablePage(table).page(command);
}

}  // namespace stillmap::mapping

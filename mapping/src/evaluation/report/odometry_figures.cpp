#include "evaluation/report/odometry_figures.hpp"

#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <map>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr double kPathWidth = 720.0;
/// Heights between which the drawing of a path takes its own shape.
constexpr double kLowestPath = 300.0;
constexpr double kHighestPath = 640.0;
/// Free space around what is drawn, of its extent.
constexpr double kMargin = 0.04;
/// What a drawing shows at least [m], so that rounding does not fill it.
constexpr double kSmallest = 1e-3;
/// Steps along a path that no one sees, of the extent.
constexpr double kInvisible = 1.0 / 2000.0;

constexpr const char* kOdometryCurve = "c0";
constexpr const char* kCorrectedStyle = "c2";

using Points = std::vector<SvgPlot::Point>;
using PlaceOf = std::function<Eigen::Vector3d(const FollowedScan&)>;

/// Least and largest value.
struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  [[nodiscard]] double middle() const { return 0.5 * (low + high); }
  [[nodiscard]] double extent() const { return std::max(high - low, kSmallest); }
};

/// A path as it is drawn: what it is called, how it looks, where it puts a scan of the drive.
struct DrawnPath {
  const char* style;
  std::map<std::size_t, Eigen::Vector3d> places;
};

DrawnPath truth_path(const OdometryEvaluation& evaluation) {
  DrawnPath path{.style = "truth", .places = {}};
  for (const FollowedScan& scan : evaluation.path) {
    if (scan.T_truth_lidar) path.places[scan.scan] = scan.T_truth_lidar->translation();
  }
  return path;
}

/// The truth first, what is asked for last, so on top.
std::vector<DrawnPath> paths_of(const OdometryEvaluation& evaluation) {
  std::vector<DrawnPath> paths{truth_path(evaluation)};
  DrawnPath& odometry = paths.emplace_back(DrawnPath{.style = kOdometryCurve, .places = {}});
  for (const FollowedScan& scan : evaluation.path)
    odometry.places[scan.scan] =
        evaluation.odometry.T_truth_estimate * scan.T_odom_lidar.translation();
  if (!evaluation.corrected) return paths;
  DrawnPath& corrected = paths.emplace_back(DrawnPath{.style = kCorrectedStyle, .places = {}});
  for (const FollowedScan& scan : evaluation.path)
    corrected.places[scan.scan] =
        evaluation.corrected->T_truth_estimate * scan.T_map_lidar.translation();
  return paths;
}

/// Points a visible step apart.
Points thinned(const Points& points, double step) {
  Points out;
  for (const SvgPlot::Point& point : points) {
    const bool near = !out.empty() && std::abs(point.first - out.back().first) < step &&
                      std::abs(point.second - out.back().second) < step;
    if (!near || &point == &points.back()) out.push_back(point);
  }
  return out;
}

/// Axes of one scale around everything, and a drawing of about that shape.
struct PathFrame {
  explicit PathFrame(const std::vector<DrawnPath>& paths) {
    Range across, along;
    for (const DrawnPath& path : paths) {
      for (const auto& [scan, place] : path.places) {
        across.add(place.x());
        along.add(place.y());
      }
    }
    const double shape = along.extent() / across.extent();
    const double lowest = SvgPlot::aspect_of({kPathWidth, kLowestPath});
    const double highest = SvgPlot::aspect_of({kPathWidth, kHighestPath});
    const double share = (std::clamp(shape, lowest, highest) - lowest) / (highest - lowest);
    size.height = kLowestPath + share * (kHighestPath - kLowestPath);
    const double aspect = SvgPlot::aspect_of(size);
    const double half = (0.5 + kMargin) * std::max(across.extent(), along.extent() / aspect);
    x = {.label = "x [m]", .min = across.middle() - half, .max = across.middle() + half};
    y = {.label = "y [m]",
         .min = along.middle() - aspect * half,
         .max = along.middle() + aspect * half};
  }
  SvgPlot::Size size{kPathWidth, kLowestPath};
  PlotAxis x, y;
};

void add_loops(const OdometryEvaluation& evaluation, const DrawnPath& path, double dot,
               SvgPlot& plot) {
  if (!evaluation.loops) return;
  for (const EvaluatedLoop& loop : evaluation.loops->loops) {
    const Eigen::Vector3d& from = path.places.at(loop.from_scan);
    const Eigen::Vector3d& to = path.places.at(loop.to_scan);
    const char* style = loop.right ? "loop" : "wrongloop";
    plot.add_line({{from.x(), from.y()}, {to.x(), to.y()}}, style);
    plot.add_box({to.x() - dot, to.y() - dot}, {to.x() + dot, to.y() + dot},
                 loop.right ? "dot" : "wrong");
  }
}

/// Lines along the way, each with its style.
struct Course {
  const char* style;
  Points points;
};

std::string course_figure(const std::vector<Course>& courses, const std::string& label,
                          const std::string& title, bool from_zero) {
  Range way, value;
  if (from_zero) value.add(0.0);
  for (const Course& course : courses) {
    for (const auto& [x, y] : course.points) {
      way.add(x);
      value.add(y);
    }
  }
  const double above = kMargin * value.extent();
  const PlotAxis x{.label = "way [m]", .min = way.low, .max = way.low + way.extent()};
  const PlotAxis y{.label = label,
                   .min = from_zero ? 0.0 : value.low - above,
                   .max = value.low + value.extent() + above};
  SvgPlot plot(x, y);
  for (const Course& course : courses)
    plot.add_line(thinned(course.points, kInvisible * way.extent()), course.style);
  return plot.svg(title);
}

Points column_of(const TrajectoryErrors& errors, std::size_t column) {
  Points points;
  for (const auto& row : errors.course_m) points.emplace_back(row[0], row.at(column));
  return points;
}

std::string distance_figure(const OdometryEvaluation& evaluation, std::size_t column,
                            const std::string& title) {
  std::vector<Course> courses{{kOdometryCurve, column_of(evaluation.odometry, column)}};
  if (evaluation.corrected)
    courses.push_back({kCorrectedStyle, column_of(*evaluation.corrected, column)});
  return course_figure(courses, "distance from the truth [m]", title, true);
}

std::string length_figure(const OdometryEvaluation& evaluation, const std::string& label,
                          const std::string& title,
                          const std::function<double(const LengthErrors&)>& error) {
  std::vector<Course> courses;
  const auto add = [&](const char* style, const TrajectoryErrors& errors) {
    Course& course = courses.emplace_back(Course{style, {}});
    for (const LengthErrors& each : errors.kitti.lengths)
      course.points.emplace_back(each.length_m, error(each));
  };
  add(kOdometryCurve, evaluation.odometry);
  if (evaluation.corrected) add(kCorrectedStyle, *evaluation.corrected);
  double most = kSmallest;
  for (const Course& course : courses) {
    for (const auto& point : course.points) most = std::max(most, point.second);
  }
  SvgPlot plot({.label = "length of segments [m]", .min = 0.0, .max = 850.0},
               {.label = label, .max = (1.0 + 2.0 * kMargin) * most});
  for (const Course& course : courses) {
    if (course.points.size() > 1) plot.add_line(course.points, course.style);
    for (const auto& [x, y] : course.points)
      plot.add_box({x - 8.0, y - 0.012 * most}, {x + 8.0, y + 0.012 * most},
                   fmt::format("fill {}", course.style));
  }
  return plot.svg(title);
}

}  // namespace

std::string path_figure(const OdometryEvaluation& evaluation) {
  const std::vector<DrawnPath> paths = paths_of(evaluation);
  const PathFrame frame(paths);
  SvgPlot plot(frame.x, frame.y, frame.size);
  const double extent = frame.x.max - frame.x.min;
  for (const DrawnPath& path : paths) {
    Points points;
    for (const auto& [scan, place] : path.places) points.emplace_back(place.x(), place.y());
    plot.add_line(thinned(points, kInvisible * extent), path.style);
  }
  add_loops(evaluation, paths.back(), 0.002 * extent, plot);
  return plot.svg("Paths from above");
}

std::string height_figure(const OdometryEvaluation& evaluation) {
  std::vector<Course> courses;
  const std::vector<DrawnPath> paths = paths_of(evaluation);
  for (const DrawnPath& path : paths) {
    Course& course = courses.emplace_back(Course{path.style, {}});
    std::size_t i = 0;
    for (const auto& [scan, truth] : paths.front().places)
      course.points.emplace_back(evaluation.odometry.course_m.at(i++)[0], path.places.at(scan).z());
  }
  return course_figure(courses, "z [m]", "Heights along the way", false);
}

std::string aligned_figure(const OdometryEvaluation& evaluation) {
  return distance_figure(evaluation, 1, "Distance along the way, best rigid motion");
}

std::string from_start_figure(const OdometryEvaluation& evaluation) {
  return distance_figure(evaluation, 2, "Distance along the way, from the start");
}

std::string translation_by_length_figure(const OdometryEvaluation& evaluation) {
  return length_figure(evaluation, "translation [%]", "Translation error by length",
                       [](const LengthErrors& each) { return each.translation_percent; });
}

std::string rotation_by_length_figure(const OdometryEvaluation& evaluation) {
  return length_figure(evaluation, "rotation [deg/100 m]", "Rotation error by length",
                       [](const LengthErrors& each) { return each.rotation_deg_per_100m; });
}

}  // namespace stillmap::mapping

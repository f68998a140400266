// How well the ground stage does on a labelled drive.
//
//   ground_figures DRIVE [--learn N] [--select begin:end:step] [--sensor-height M] [--repeat N]
//
// Labels as in the Patchwork++ paper: road, parking, pavement, other ground, lane marking and
// terrain are ground; vegetation and what has no label are left out of the count. Every other point
// counts, whatever its range. Precision and recall are over the points of all scans together.
//
// Where the drive has `truth/ground.ply`, the surface's height error within 25 m too, at one place
// in each cell of 0.5 m that holds a true ground point, and apart from that at one place in each
// cell that holds a point of something movable: there it is what objects are put down on.
//
// Times are of one thread: on the wall, for which it must run alone, and of the processor.

#include "evaluation/labels/ground_mesh.hpp"

#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <exception>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace stillmap::test {
namespace {

constexpr double kHeightRangeM = 25.0;
constexpr double kPlaceM = 0.5;

bool is_ground_class(std::uint32_t label) {
  return label == 40 || label == 44 || label == 48 || label == 49 || label == 60 || label == 72;
}
bool is_left_out(std::uint32_t label) { return label == 0 || label == 1 || label == 70; }
bool is_movable(std::uint32_t label) { return (label >= 10 && label <= 32) || label >= 252; }

struct Counts {
  std::size_t true_ground = 0, found = 0, right = 0;

  [[nodiscard]] double precision() const {
    return found == 0 ? 0.0 : static_cast<double>(right) / static_cast<double>(found);
  }
  [[nodiscard]] double recall() const {
    return true_ground == 0 ? 0.0 : static_cast<double>(right) / static_cast<double>(true_ground);
  }
  [[nodiscard]] double f1() const {
    const double sum = precision() + recall();
    return sum == 0.0 ? 0.0 : 2.0 * precision() * recall() / sum;
  }
  Counts& operator+=(const Counts& other) {
    true_ground += other.true_ground;
    found += other.found;
    right += other.right;
    return *this;
  }
};

struct Heights {
  std::vector<double> errors_m;
  std::size_t places = 0;
};

struct Figures {
  Counts total;
  std::vector<double> f1_of_scan, wall_ms, cpu_ms, points_of_scan;
  Heights on_ground, under_movable;
  /// Of each class: points that were counted wrongly.
  std::map<std::uint32_t, std::size_t> wrong_of_class;
};

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  const auto rank = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

struct LabelledScan {
  maps::PointCloud cloud;
  std::vector<std::uint32_t> labels;
};

LabelledScan read_labelled(const maps::Drive& drive, std::size_t index) {
  LabelledScan out;
  maps::Scan scan = drive.read(index);
  out.labels = drive.read_labels(index);
  if (out.labels.size() != scan.cloud.size()) {
    throw maps::InputError(scan.source, fmt::format("{} labels", out.labels.size()),
                           fmt::format("one for each of {} usable points", scan.cloud.size()));
  }
  for (std::uint32_t& label : out.labels) label &= 0xffffU;
  out.cloud = std::move(scan.cloud);
  return out;
}

Counts count(const LabelledScan& scan, const mapping::GroundResult& ground, Figures& figures) {
  Counts counts;
  for (std::size_t i = 0; i < scan.labels.size(); ++i) {
    const std::uint32_t label = scan.labels[i];
    if (is_left_out(label)) continue;
    const bool truth = is_ground_class(label), found = ground.is_ground[i] != 0;
    counts.true_ground += truth ? 1 : 0;
    counts.found += found ? 1 : 0;
    counts.right += truth && found ? 1 : 0;
    if (truth != found) ++figures.wrong_of_class[label];
  }
  return counts;
}

/// One place in each cell of the horizontal plane that holds a point of the kind.
template <typename Kind>
std::vector<Eigen::Vector2d> places_of(const LabelledScan& scan, Kind is_kind) {
  std::vector<Eigen::Vector2d> places;
  std::set<std::pair<int, int>> seen;
  for (std::size_t i = 0; i < scan.labels.size(); ++i) {
    const Eigen::Vector2d p = scan.cloud.positions[i].head<2>().cast<double>();
    if (!is_kind(scan.labels[i]) || p.norm() > kHeightRangeM) continue;
    const auto cell = std::pair{static_cast<int>(std::floor(p.x() / kPlaceM)),
                                static_cast<int>(std::floor(p.y() / kPlaceM))};
    if (seen.insert(cell).second) places.push_back(p);
  }
  return places;
}

void measure_heights(const std::vector<Eigen::Vector2d>& places,
                     const mapping::GroundSurface& surface, const mapping::GroundMesh& truth,
                     const Eigen::Isometry3d& T_map_lidar, Heights& heights) {
  for (const Eigen::Vector2d& place : places) {
    ++heights.places;
    const auto sample = surface.at(place.x(), place.y());
    if (!sample) continue;
    const Eigen::Vector3d p_map = T_map_lidar * Eigen::Vector3d(place.x(), place.y(), sample->z);
    const auto z = truth.height(p_map.x(), p_map.y());
    if (z) heights.errors_m.push_back(p_map.z() - *z);
  }
}

struct Request {
  std::filesystem::path drive;
  std::string select = "::1";
  std::size_t learn = 0;
  std::optional<double> sensor_height_m;
  int repeat = 1;
};

Figures measure(const maps::Drive& drive, const Request& request) {
  mapping::GroundOptions options;
  options.sensor_height_m = request.sensor_height_m;
  const auto segmenter = mapping::make_ground_segmenter(options);
  for (std::size_t k = 0; k < request.learn; ++k)
    segmenter->learn(drive.read(k * drive.size() / request.learn).cloud);
  std::optional<mapping::GroundMesh> truth;
  if (std::filesystem::exists(request.drive / "truth/ground.ply") && drive.has_poses())
    truth = mapping::read_ground_mesh(request.drive / "truth/ground.ply");
  Figures figures;
  for (const std::size_t index : maps::Selection::parse(request.select).indices(drive.size())) {
    const LabelledScan scan = read_labelled(drive, index);
    mapping::GroundResult ground;
    for (int k = 0; k < request.repeat; ++k) {
      const auto began = std::chrono::steady_clock::now();
      const double cpu_began_s = cpu_seconds();
      ground = segmenter->segment(scan.cloud);
      figures.cpu_ms.push_back(1000.0 * (cpu_seconds() - cpu_began_s));
      const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
      figures.wall_ms.push_back(1000.0 * took.count());
    }
    figures.points_of_scan.push_back(static_cast<double>(scan.cloud.size()));
    const Counts counts = count(scan, ground, figures);
    figures.total += counts;
    figures.f1_of_scan.push_back(counts.f1());
    if (!truth) continue;
    measure_heights(places_of(scan, is_ground_class), *ground.surface, *truth,
                    drive.T_map_lidar(index), figures.on_ground);
    measure_heights(places_of(scan, is_movable), *ground.surface, *truth, drive.T_map_lidar(index),
                    figures.under_movable);
  }
  return figures;
}

void print_heights(const char* where, const Heights& heights) {
  if (heights.places == 0) return;
  std::vector<double> absolute(heights.errors_m);
  for (double& error : absolute) error = std::abs(error);
  fmt::print(
      "{}: known at {:.1f} % of {} places, error median {:+.1f} cm, absolute {:.1f} cm, "
      "95 % {:.1f} cm\n",
      where, 100.0 * static_cast<double>(absolute.size()) / static_cast<double>(heights.places),
      heights.places, 100 * percentile(heights.errors_m, 0.5), 100 * percentile(absolute, 0.5),
      100 * percentile(absolute, 0.95));
}

void print(const Figures& figures) {
  const Counts& total = figures.total;
  fmt::print("scans {}: precision {:.2f} %, recall {:.2f} %, F1 {:.2f} % (worst scan {:.2f} %)\n",
             figures.f1_of_scan.size(), 100 * total.precision(), 100 * total.recall(),
             100 * total.f1(), 100 * percentile(figures.f1_of_scan, 0.0));
  fmt::print("wrong, in % of true ground points:");
  for (const auto& [label, points] : figures.wrong_of_class) {
    fmt::print(" {}:{:.2f}", label,
               100.0 * static_cast<double>(points) / static_cast<double>(total.true_ground));
  }
  fmt::print(
      "\n{:.1f} ms a scan of {:.0f} points (median; fastest {:.1f}); processor {:.1f} ms "
      "(fastest {:.1f})\n",
      percentile(figures.wall_ms, 0.5), percentile(figures.points_of_scan, 0.5),
      percentile(figures.wall_ms, 0.0), percentile(figures.cpu_ms, 0.5),
      percentile(figures.cpu_ms, 0.0));
  print_heights("height on ground within 25 m", figures.on_ground);
  print_heights("height under what is movable within 25 m", figures.under_movable);
}

int run(int argc, char** argv) {
  CLI::App app("Ground flags and heights against a labelled drive");
  Request request;
  app.add_option("DRIVE", request.drive, "Drive with SemanticKITTI labels")
      ->required()
      ->check(CLI::ExistingDirectory);
  app.add_option("--learn", request.learn, "Scans to learn from first, spread over the drive");
  app.add_option("--select", request.select, "Scans to count, begin:end:step")
      ->capture_default_str();
  app.add_option("--sensor-height", request.sensor_height_m, "Given instead of estimated [m]");
  app.add_option("--repeat", request.repeat, "Times that each scan is segmented, for its time")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  print(measure(maps::Drive::open(request.drive), request));
  return 0;
}

}  // namespace
}  // namespace stillmap::test

int main(int argc, char** argv) {
  try {
    return stillmap::test::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "ground_figures: {}\n", error.what());
    return 1;
  }
}

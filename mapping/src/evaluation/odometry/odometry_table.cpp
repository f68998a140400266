#include <stillmap/mapping/odometry_table.hpp>

#include "evaluation/odometry/table_differences.hpp"
#include "evaluation/odometry/table_pieces.hpp"
#include "evaluation/paper/paper_pieces.hpp"
#include "evaluation/paper/paper_plan.hpp"
#include "evaluation/require_once.hpp"

#include <stillmap/mapping/detector.hpp>
#include <stillmap/maps/drive.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <iterator>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

using Clock = std::chrono::steady_clock;

/// Time of a scan beside that of simulating one.
constexpr std::size_t kSimulateEffort = 2;
constexpr std::size_t kRawEffort = 2;
constexpr std::size_t kTreatedEffort = 3;
constexpr std::size_t kSimulateStages = 2;
/// Odometry, candidates and verification of loops.
constexpr std::size_t kFollowStages = 3;

constexpr std::array<MovablePolicy, 3> kPoints{MovablePolicy::kKeep, MovablePolicy::kProject,
                                               MovablePolicy::kDelete};

PathFigures figures_of(const TrajectoryErrors& errors) {
  return {.ape_mean_m = errors.aligned_m.mean,
          .ate_rmse_m = errors.aligned_m.rmse,
          .kitti_percent = errors.kitti.translation_percent,
          .kitti_deg_per_100m = errors.kitti.rotation_deg_per_100m,
          .percent_10m = errors.relative.translation_percent_10m,
          .deg_10m = errors.relative.rotation_deg_10m};
}

OdometryTableRun run_of(const std::string& drive, const OdometryEvaluation& evaluation) {
  OdometryTableRun run;
  run.drive = drive;
  run.scans = evaluation.scans;
  run.way_m = evaluation.odometry.way_m;
  run.method = evaluation.options.method;
  run.points = evaluation.options.movable;
  run.without_loops = figures_of(evaluation.odometry);
  run.with_loops = figures_of(evaluation.errors());
  run.loops_found = evaluation.loops->found;
  run.loops_right = evaluation.loops->right;
  run.revisits = evaluation.loops->revisits;
  run.revisits_found = evaluation.loops->revisits_found;
  run.matched = evaluation.matched;
  run.partly = evaluation.partly;
  run.predicted = evaluation.predicted;
  run.treated = evaluation.points;
  run.scans_per_second = evaluation.scans_per_second;
  return run;
}

/// What is missing of a table, as steps in the order in which they are made.
class TablePlan {
 public:
  TablePlan(const OdometryTableOptions& options, const SimulateStreet& simulate,
            const std::filesystem::path& work, bool keep, const CancelFlag& cancel)
      : options_(options), simulate_(simulate), work_(work), keep_(keep), cancel_(cancel) {}

  [[nodiscard]] std::vector<PaperStep> steps(const TableDrive& drive) const {
    std::vector<PaperStep> steps;
    for (const std::string& method : options_.methods) {
      for (const MovablePolicy points : kPoints) {
        const RunPiece piece = run_piece(options_, drive, method, points, work_);
        if (!read_run(piece)) steps.push_back(follow(drive, method, points, piece));
      }
    }
    if (steps.empty() || !drive.seed) return steps;
    if (!is_whole_drive(drive.folder, options_.scans)) steps.insert(steps.begin(), simulate(drive));
    if (!keep_)
      steps.push_back({drive.name + " done", 1, 1, [drive](const ProgressCallback&) {
                         std::filesystem::remove_all(drive.folder);
                       }});
    return steps;
  }

 private:
  [[nodiscard]] std::size_t scans_of(const TableDrive& drive) const {
    return drive.seed ? options_.scans : maps::Drive::open(drive.folder).size();
  }

  [[nodiscard]] PaperStep simulate(const TableDrive& drive) const {
    return {drive.name, options_.scans * kSimulateEffort, kSimulateStages,
            [this, drive](const ProgressCallback& progress) {
              simulate_(options_, *drive.seed, drive.folder, progress, cancel_);
            }};
  }

  [[nodiscard]] PaperStep follow(const TableDrive& drive, const std::string& method,
                                 MovablePolicy points, const RunPiece& piece) const {
    const std::size_t effort = points == MovablePolicy::kKeep ? kRawEffort : kTreatedEffort;
    return {fmt::format("{} {} {}", drive.name, method, points_name(points)),
            effort * scans_of(drive), kFollowStages,
            [this, drive, method, points, piece](const ProgressCallback& progress) {
              OdometryEvaluationOptions options;
              options.method = method;
              options.movable = points;
              options.detector = options_.detector;
              options.threads = options_.threads;
              std::filesystem::path scratch = piece.file;
              scratch += ".scratch";
              std::filesystem::remove_all(scratch);
              std::filesystem::create_directories(scratch);
              const OdometryEvaluation evaluation = evaluate_odometry(
                  maps::Drive::open(drive.folder), options, scratch, progress, cancel_);
              std::filesystem::remove_all(scratch);
              write_run(piece, run_of(drive.name, evaluation));
            }};
  }

  const OdometryTableOptions& options_;
  const SimulateStreet& simulate_;
  const std::filesystem::path& work_;
  bool keep_;
  const CancelFlag& cancel_;
};

}  // namespace

std::vector<std::string> OdometryTableOptions::violations() const {
  std::vector<std::string> broken;
  if (seeds.empty() && drives.empty() && !kitti) broken.emplace_back("seeds: none, at least one");
  if (methods.empty()) broken.emplace_back("methods: none, at least one");
  require_once("seeds", seeds, broken);
  require_once("methods", methods, broken);
  require_once("sequences", sequences, broken);
  const std::vector<std::string> known = odometry_names();
  for (const std::string& method : methods) {
    if (std::find(known.begin(), known.end(), method) == known.end())
      broken.push_back(fmt::format("methods: {}, of {}", method, fmt::join(known, ", ")));
  }
  if (scans < 10 || scans > 10000)
    broken.push_back(fmt::format("scans: {}, in [10, 10000]", scans));
  if (threads < 0 || threads > 256)
    broken.push_back(fmt::format("threads: {}, in [0, 256]", threads));
  return broken;
}

OdometryTable evaluate_odometry_table(const OdometryTableOptions& options,
                                      const SimulateStreet& simulate,
                                      const std::filesystem::path& work, bool keep,
                                      const ProgressCallback& progress, const CancelFlag& cancel) {
  const Clock::time_point began = Clock::now();
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  (void)make_detector(options.detector, 0);
  OdometryTable table;
  table.options = options;
  const std::vector<TableDrive> drives = table_drives(options, work, table.missing);
  for (const char* name : {"drives", "odometry"}) std::filesystem::create_directories(work / name);
  const TablePlan plan(options, simulate, work, keep, cancel);
  std::vector<PaperStep> steps;
  for (const TableDrive& drive : drives) {
    std::vector<PaperStep> more = plan.steps(drive);
    std::move(more.begin(), more.end(), std::back_inserter(steps));
  }
  run_steps(steps, progress, cancel);
  for (const TableDrive& drive : drives) {
    for (const std::string& method : options.methods) {
      for (const MovablePolicy points : kPoints)
        table.runs.push_back(read_run(run_piece(options, drive, method, points, work)).value());
    }
    const OdometryTableRun& last = table.runs.back();
    table.drives.push_back(
        {.name = drive.name, .scans = last.scans, .way_m = last.way_m, .paper_m = drive.paper_m});
  }
  table.differences = differences_of(table.runs);
  table.seconds = std::chrono::duration<double>(Clock::now() - began).count();
  return table;
}

}  // namespace stillmap::mapping

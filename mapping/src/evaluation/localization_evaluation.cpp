#include <stillmap/mapping/localization_evaluation.hpp>

#include "evaluation/localization_metrics.hpp"
#include "evaluation/prior_draws.hpp"

#include <stillmap/mapping/deskew.hpp>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <ctime>
#include <mutex>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

double thread_cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

double wall_ms() {
  return std::chrono::duration<double, std::milli>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

maps::PointCloud deskewed_scan(const maps::Drive& drive, std::size_t index) {
  maps::PointCloud cloud = drive.read(index).cloud;
  const std::optional<Vector6d> twist = twist_at(drive, index);
  if (twist) deskew(cloud, *twist);
  return cloud;
}

LocalizationRecord ask(const localization::Aligner& aligner, const maps::PointCloud& scan_lidar,
                       const Eigen::Isometry3d& T_map_lidar,
                       const Eigen::Isometry3d& T_map_lidar_prior) {
  const double cpu_start = thread_cpu_ms();
  const double wall_start = wall_ms();
  localization::AlignmentResult answer =
      aligner.align(scan_lidar, localization::Prior{T_map_lidar_prior, std::nullopt});
  LocalizationRecord record;
  record.cpu_ms = thread_cpu_ms() - cpu_start;
  record.wall_ms = wall_ms() - wall_start;
  record.status = answer.status;
  record.reasons = std::move(answer.reasons);
  record.T_reference_answer = T_map_lidar.inverse() * answer.T_map_lidar;
  record.covariance = answer.covariance;
  return record;
}

void require_usable(const maps::Drive& drive, const LocalizationEvaluationOptions& options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  const std::size_t references = options.reference.size();
  if (references != 0 && references != drive.size()) {
    throw std::invalid_argument(
        fmt::format("reference: {} entries, one for each of {} scans", references, drive.size()));
  }
  if (references == 0 && !drive.has_poses()) {
    throw std::invalid_argument(drive.contents().root.string() +
                                ": found no poses, expected one a scan");
  }
}

/// The pose that answers for a scan are compared with; the scan is one of `scans_to_ask`.
const Eigen::Isometry3d& T_map_lidar_of(const maps::Drive& drive,
                                        const LocalizationEvaluationOptions& options,
                                        std::size_t index) {
  return options.reference.empty() ? drive.T_map_lidar(index) : options.reference[index].value();
}

std::vector<std::size_t> scans_to_ask(const maps::Drive& drive,
                                      const LocalizationEvaluationOptions& options) {
  std::vector<std::size_t> scans = options.selection.indices(drive.size());
  if (!options.reference.empty())
    std::erase_if(scans, [&](std::size_t index) { return !options.reference[index]; });
  if (scans.empty()) {
    throw std::invalid_argument(fmt::format("selection: no scan of {}{}", drive.size(),
                                            options.reference.empty() ? "" : " has a pose"));
  }
  return scans;
}

}  // namespace

std::vector<std::string> LocalizationEvaluationOptions::violations() const {
  std::vector<std::string> broken;
  if (prior_errors.empty()) broken.emplace_back("prior_errors: none, at least one");
  for (const PriorError& error : prior_errors) {
    if (!(error.metres >= 0.0 && std::isfinite(error.metres))) {
      broken.push_back(fmt::format("prior_errors: {} m, >= 0", error.metres));
    }
    if (!(error.degrees >= 0.0 && error.degrees <= 180.0)) {
      broken.push_back(fmt::format("prior_errors: {} deg, in [0, 180]", error.degrees));
    }
  }
  if (trials < 1) broken.push_back(fmt::format("trials: {}, >= 1", trials));
  if (threads < 0) broken.push_back(fmt::format("threads: {}, >= 0", threads));
  return broken;
}

LocalizationEvaluation evaluate_localization(const maps::MapPackage& map, const maps::Drive& drive,
                                             const LocalizationEvaluationOptions& options,
                                             const AlignerFactory& make_aligner,
                                             const ProgressCallback& progress,
                                             const CancelFlag& cancel) {
  require_usable(drive, options);
  const double start_ms = wall_ms();
  const std::vector<std::size_t> scans = scans_to_ask(drive, options);
  const std::unique_ptr<localization::Aligner> aligner = make_aligner(map);
  const auto trials = static_cast<std::size_t>(options.trials);
  std::vector<std::vector<LocalizationRecord>> records(
      options.prior_errors.size(), std::vector<LocalizationRecord>(scans.size() * trials));
  std::mutex progress_mutex;
  std::size_t done = 0;
  const auto ask_for_scan = [&](std::size_t position) {
    const std::size_t index = scans[position];
    const maps::PointCloud scan_lidar = deskewed_scan(drive, index);
    const Eigen::Isometry3d& T_map_lidar = T_map_lidar_of(drive, options, index);
    for (std::size_t level = 0; level < records.size(); ++level) {
      for (std::size_t trial = 0; trial < trials; ++trial) {
        if (cancel) throw Cancelled();
        const Eigen::Isometry3d prior = with_prior_error(T_map_lidar, options.prior_errors[level],
                                                         CounterRandom(options.seed, index, trial));
        LocalizationRecord& record = records[level][position * trials + trial];
        record = ask(*aligner, scan_lidar, T_map_lidar, prior);
        record.scan = position;
      }
    }
    const std::lock_guard lock(progress_mutex);
    if (progress) progress("localize", ++done, scans.size());
  };
  tbb::task_arena arena(options.threads == 0 ? tbb::task_arena::automatic : options.threads);
  arena.execute([&] { tbb::parallel_for(std::size_t{0}, scans.size(), ask_for_scan); });
  LocalizationEvaluation evaluation;
  evaluation.scans = scans.size();
  evaluation.options = options;
  for (std::size_t level = 0; level < records.size(); ++level) {
    evaluation.levels.push_back(
        level_of(records[level], options.prior_errors[level], options.seed));
  }
  evaluation.seconds = (wall_ms() - start_ms) * 1e-3;
  return evaluation;
}

}  // namespace stillmap::mapping

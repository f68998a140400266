#include <stillmap/mapping/localization_evaluation.hpp>

#include "evaluation/localization/localization_metrics.hpp"
#include "evaluation/localization/prior_draws.hpp"
#include "evaluation/localization/query_scans.hpp"
#include "trajectory/drive_of_map.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <cmath>
#include <ctime>
#include <limits>
#include <mutex>
#include <numbers>
#include <optional>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr PriorError kNoPrior{.metres = std::numeric_limits<double>::quiet_NaN(),
                              .degrees = std::numeric_limits<double>::quiet_NaN()};

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

LocalizationRecord ask(const localization::Aligner& aligner, const maps::PointCloud& scan_lidar,
                       const Eigen::Isometry3d& T_map_lidar,
                       const std::optional<localization::Prior>& prior) {
  const double cpu_start = thread_cpu_ms();
  const double wall_start = wall_ms();
  localization::AlignmentResult answer = aligner.align(scan_lidar, prior);
  LocalizationRecord record;
  record.query.cpu_ms = thread_cpu_ms() - cpu_start;
  record.query.wall_ms = wall_ms() - wall_start;
  record.query.status = answer.status;
  record.query.reasons = std::move(answer.reasons);
  record.query.protection = answer.protection;
  record.query.inlier_ratio = answer.inlier_ratio;
  record.T_reference_answer = T_map_lidar.inverse() * answer.T_map_lidar;
  record.covariance = answer.covariance;
  return record;
}

bool has_pose(const LocalizationEvaluationOptions& options, std::size_t index) {
  return options.reference.empty() || options.reference[index].has_value();
}

/// The pose that an answer is compared with, or a prior taken from; the scan must have one.
const Eigen::Isometry3d& T_map_lidar_of(const maps::Drive& drive,
                                        const LocalizationEvaluationOptions& options,
                                        std::size_t index) {
  return options.reference.empty() ? drive.T_map_lidar(index) : options.reference[index].value();
}

/// The scans that can be asked for.
std::vector<std::size_t> scans_of(const maps::Drive& drive,
                                  const LocalizationEvaluationOptions& options) {
  std::vector<std::size_t> scans = options.selection.indices(drive.size());
  std::erase_if(scans, [&](std::size_t index) {
    if (!has_pose(options, index)) return true;
    return options.prior == PriorSource::kPrevious && (index == 0 || !has_pose(options, index - 1));
  });
  return scans;
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
                                ": found no poses, expected one a scan: give --poses FILE");
  }
  if (scans_of(drive, options).empty()) {
    throw std::invalid_argument(
        fmt::format("selection: no scan of {}{}{}", drive.size(),
                    options.reference.empty() ? "" : " has a pose",
                    options.prior == PriorSource::kPrevious ? " that has one before it" : ""));
  }
}

/// A map's own drive lies in it where the build placed it.
maps::Drive as_in_map(const maps::MapPackage& map, const maps::Drive& drive) {
  const auto found = find_in_map(map, drive);
  return found ? on_path(drive, found->path) : drive;
}

/// As in the definition of a drawn error: horizontal distance and yaw.
PriorError error_between(const Eigen::Isometry3d& T_map_lidar,
                         const Eigen::Isometry3d& T_map_lidar_prior) {
  const Eigen::Matrix3d turn = T_map_lidar.linear().transpose() * T_map_lidar_prior.linear();
  return {.metres = (T_map_lidar_prior.translation() - T_map_lidar.translation()).head<2>().norm(),
          .degrees = std::abs(std::atan2(turn(1, 0), turn(0, 0))) * 180.0 / std::numbers::pi};
}

std::optional<Eigen::Matrix<double, 6, 6>> covariance_of(const std::optional<PriorError>& sigma) {
  if (!sigma) return std::nullopt;
  Vector6d deviations;
  deviations << Eigen::Vector3d::Constant(sigma->metres),
      Eigen::Vector3d::Constant(sigma->degrees * std::numbers::pi / 180.0);
  return deviations.cwiseAbs2().asDiagonal().toDenseMatrix();
}

/// All queries of one evaluation, in an order that does not depend on the threads.
class Questions {
 public:
  Questions(const maps::Drive& drive, const LocalizationEvaluationOptions& options,
            const localization::Aligner& aligner, const CancelFlag& cancel)
      : drive_(drive),
        options_(options),
        aligner_(aligner),
        scans_(scans_of(drive, options)),
        queries_(drive, options, scans_, cancel),
        trials_(static_cast<std::size_t>(options.trials)),
        records_(options.prior == PriorSource::kDrawn ? options.prior_errors.size() : 1,
                 std::vector<LocalizationRecord>(scans_.size() * trials_)) {}

  /// @return what was done to the scan's points.
  QueryPoints ask_for_scan(std::size_t position, const CancelFlag& cancel) {
    const std::size_t index = scans_[position];
    QueryPoints points;
    const maps::PointCloud scan_lidar = queries_.read(index, points);
    for (std::size_t level = 0; level < records_.size(); ++level) {
      for (std::size_t trial = 0; trial < trials_; ++trial) {
        if (cancel) throw Cancelled();
        const std::optional<Eigen::Isometry3d> prior = prior_of(index, level, trial);
        LocalizationRecord& record = records_[level][position * trials_ + trial];
        std::optional<localization::Prior> sent;
        if (prior) sent = localization::Prior{*prior, covariance_of(options_.prior_sigma)};
        record = ask(aligner_, scan_lidar, T_map_lidar(index), sent);
        record.position = position;
        record.query.scan = index;
        record.query.trial = static_cast<int>(trial);
        record.query.prior_error = prior_error_of(index, level, prior);
      }
    }
    return points;
  }

  [[nodiscard]] std::size_t scans() const { return scans_.size(); }
  [[nodiscard]] const std::vector<std::vector<LocalizationRecord>>& records() const {
    return records_;
  }

 private:
  [[nodiscard]] const Eigen::Isometry3d& T_map_lidar(std::size_t index) const {
    return T_map_lidar_of(drive_, options_, index);
  }
  [[nodiscard]] std::optional<Eigen::Isometry3d> prior_of(std::size_t index, std::size_t level,
                                                          std::size_t trial) const {
    switch (options_.prior) {
      case PriorSource::kDrawn:
        return with_prior_error(T_map_lidar(index), options_.prior_errors[level],
                                CounterRandom(options_.seed, index, trial));
      case PriorSource::kPrevious:
        return T_map_lidar(index - 1);
      case PriorSource::kNone:
        break;
    }
    return std::nullopt;
  }

  [[nodiscard]] PriorError prior_error_of(std::size_t index, std::size_t level,
                                          const std::optional<Eigen::Isometry3d>& prior) const {
    if (!prior) return kNoPrior;
    return options_.prior == PriorSource::kDrawn ? options_.prior_errors[level]
                                                 : error_between(T_map_lidar(index), *prior);
  }

  const maps::Drive& drive_;
  const LocalizationEvaluationOptions& options_;
  const localization::Aligner& aligner_;
  std::vector<std::size_t> scans_;
  QueryScans queries_;
  std::size_t trials_;
  std::vector<std::vector<LocalizationRecord>> records_;
};

PriorError median_prior_error(const std::vector<LocalizationQuery>& queries) {
  std::vector<double> metres, degrees;
  for (const LocalizationQuery& query : queries) {
    metres.push_back(query.prior_error.metres);
    degrees.push_back(query.prior_error.degrees);
  }
  return {.metres = percentile(metres, 0.5), .degrees = percentile(degrees, 0.5)};
}

}  // namespace

std::string_view name_of(QueryDeskew deskew) {
  switch (deskew) {
    case QueryDeskew::kVehicle:
      return "vehicle";
    case QueryDeskew::kMap:
      return "map";
    case QueryDeskew::kNone:
      return "none";
  }
  throw std::invalid_argument("QueryDeskew out of range");
}

std::string_view name_of(PriorSource source) {
  switch (source) {
    case PriorSource::kDrawn:
      return "drawn";
    case PriorSource::kPrevious:
      return "previous";
    case PriorSource::kNone:
      return "none";
  }
  throw std::invalid_argument("PriorSource out of range");
}

std::string_view name_of(BiasCorrection correction) {
  switch (correction) {
    case BiasCorrection::kFit:
      return "fit";
    case BiasCorrection::kNone:
      return "none";
  }
  throw std::invalid_argument("BiasCorrection out of range");
}

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
  if (prior_sigma && !(prior_sigma->metres > 0.0 && std::isfinite(prior_sigma->metres) &&
                       prior_sigma->degrees > 0.0 && std::isfinite(prior_sigma->degrees))) {
    broken.push_back(
        fmt::format("prior_sigma: {} m, {} deg, > 0", prior_sigma->metres, prior_sigma->degrees));
  }
  if (trials < 1) broken.push_back(fmt::format("trials: {}, >= 1", trials));
  if (trials > 1 && prior != PriorSource::kDrawn) {
    broken.push_back(fmt::format("trials: {}, 1 where no prior is drawn", trials));
  }
  if (threads < 0) broken.push_back(fmt::format("threads: {}, >= 0", threads));
  return broken;
}

LocalizationEvaluation evaluate_localization(const maps::MapPackage& map, const maps::Drive& given,
                                             const LocalizationEvaluationOptions& options,
                                             const AlignerFactory& make_aligner,
                                             const ProgressCallback& progress,
                                             const CancelFlag& cancel) {
  require_usable(given, options);
  const maps::Drive drive = options.reference.empty() ? as_in_map(map, given) : given;
  const double start_ms = wall_ms();
  const std::unique_ptr<localization::Aligner> aligner = make_aligner(map);
  Questions questions(drive, options, *aligner, cancel);
  LocalizationEvaluation evaluation;
  std::mutex progress_mutex;
  std::size_t done = 0;
  tbb::task_arena arena(options.threads == 0 ? tbb::task_arena::automatic : options.threads);
  arena.execute([&] {
    tbb::parallel_for(std::size_t{0}, questions.scans(), [&](std::size_t position) {
      const QueryPoints points = questions.ask_for_scan(position, cancel);
      const std::lock_guard lock(progress_mutex);
      evaluation.points += points;
      if (progress) progress("localize", ++done, questions.scans());
    });
  });
  evaluation.scans = questions.scans();
  evaluation.options = options;
  for (std::size_t level = 0; level < questions.records().size(); ++level) {
    const std::vector<LocalizationQuery>& queries =
        evaluation.queries.emplace_back(judged(questions.records()[level], options.bias));
    const PriorError& prior_error = options.prior == PriorSource::kDrawn
                                        ? options.prior_errors[level]
                                        : median_prior_error(queries);
    evaluation.levels.push_back(level_of(queries, prior_error, options.seed));
  }
  evaluation.seconds = (wall_ms() - start_ms) * 1e-3;
  return evaluation;
}

}  // namespace stillmap::mapping

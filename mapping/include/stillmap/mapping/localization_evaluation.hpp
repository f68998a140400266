#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/mapping/projection.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// How far a prior is off: exactly `metres` in a uniformly random horizontal direction of the map
/// and a tenth of it up or down; exactly `degrees` of yaw with random sign, and a tenth of it of
/// roll and of pitch, each with random sign (rotations on the right, in the lidar frame).
struct PriorError {
  /// >= 0
  double metres = 1.0;
  /// In [0, 180].
  double degrees = 5.0;
};

/// Where the search for a scan starts.
enum class PriorSource {
  kDrawn,     ///< off by a known error in a random direction
  kPrevious,  ///< the true pose of the drive's scan before: the paper's protocol
  kNone,      ///< anywhere in the map
};
[[nodiscard]] std::string_view name_of(PriorSource source);

/// What is done about a constant difference between the drive's poses and the map.
enum class QueryDeskew {
  kVehicle,  ///< by the vehicle's own velocity
  kMap,      ///< left to the method: points keep their times
  kNone,     ///< by nobody: points come as recorded, without times
};
[[nodiscard]] std::string_view name_of(QueryDeskew deskew);

enum class BiasCorrection {
  kFit,   ///< taken out, see `evaluate_localization`
  kNone,  ///< left in: for poses that are the truth, as a simulated drive's are
};
[[nodiscard]] std::string_view name_of(BiasCorrection correction);

/// Makes the method under test for one map; called once an evaluation. What it returns is shared by
/// all threads.
using AlignerFactory =
    std::function<std::unique_ptr<localization::Aligner>(const maps::MapPackage& map)>;

struct LocalizationEvaluationOptions {
  /// Scans of the drive that are asked for; with `kPrevious` the drive's first one is left out.
  maps::Selection selection;
  PriorSource prior = PriorSource::kDrawn;
  /// One level of the result each; not empty. Only for priors that are drawn.
  std::vector<PriorError> prior_errors{{}};
  /// Deviations that are sent with each prior (metres along each axis, degrees about each), > 0;
  /// none = priors are sent without a covariance.
  std::optional<PriorError> prior_sigma;
  /// Priors drawn for each scan, >= 1; 1 where none is drawn.
  int trials = 1;
  BiasCorrection bias = BiasCorrection::kFit;
  /// How each scan is deskewed before it is asked for.
  QueryDeskew query_deskew = QueryDeskew::kVehicle;
  /// What is done to points of movable objects in each scan before it is asked for: nothing, or
  /// they are deleted (as the paper did), or put onto the ground of that scan alone. Their time is
  /// not counted.
  MovablePolicy query_movable = MovablePolicy::kKeep;
  /// What finds them, as `make_detector`; not used with `kKeep`.
  std::string query_detector = "geometric";
  /// Same seed, same draws: for every method, machine and number of threads.
  std::uint64_t seed = 1;
  /// Threads, 0 = all cores. More make `cpu_ms` and `wall_ms` larger on a machine that shares
  /// memory bandwidth.
  int threads = 1;
  /// Poses to compare with instead of the drive's, `T_map_lidar`, one entry a scan: selected scans
  /// without one are not asked for. Empty: where the map has the drive when it was made of it
  /// (builds refine given poses), else the drive's own.
  std::vector<std::optional<Eigen::Isometry3d>> reference;

  /// Every broken bound as "name: value, bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// Points of the scans that were asked for, and what was done to them by `query_movable`.
struct QueryPoints {
  std::uint64_t in = 0;
  std::uint64_t projected = 0;
  std::uint64_t deleted = 0;
  /// Of the deleted ones those that had no ground below them to go to.
  std::uint64_t without_ground = 0;

  QueryPoints& operator+=(const QueryPoints& other) {
    in += other.in;
    projected += other.projected;
    deleted += other.deleted;
    without_ground += other.without_ground;
    return *this;
  }
};

/// One query and what came of it.
struct LocalizationQuery {
  /// Index in the drive.
  std::size_t scan = 0;
  /// From 0.
  int trial = 0;
  /// How far the prior was off; NaN without one.
  PriorError prior_error;
  localization::PoseStatus status = localization::PoseStatus::kLost;
  std::vector<localization::Reason> reasons;
  /// log(T_reference^-1 T_answer), tx ty tz [m] rx ry rz [rad] in the lidar frame, after the bias
  /// was taken out; NaN when lost.
  Eigen::Matrix<double, 6, 1> error =
      Eigen::Matrix<double, 6, 1>::Constant(std::numeric_limits<double>::quiet_NaN());
  localization::ProtectionLevels protection;
  /// Squared error in units of the answer's covariance; NaN when lost or without a covariance.
  double nees = std::numeric_limits<double>::quiet_NaN();
  double inlier_ratio = 0.0;
  double cpu_ms = 0.0;
  double wall_ms = 0.0;
};

/// How far a vehicle on a street may be off along and across its lane [m], and in yaw [rad].
/// @see Reid et al., "Localization requirements for autonomous vehicles", SAE J. CAV 2 (2019).
inline constexpr double kAlertLimitM = 0.29;
inline constexpr double kAlertLimitRad = 0.5 * std::numbers::pi / 180.0;

/// A rate with what it was counted from; NaN where there was nothing to count.
struct BoundedRate {
  std::size_t count = 0;
  std::size_t of = 0;
  double rate = std::numeric_limits<double>::quiet_NaN();
  /// The rate is below this with 95 % confidence. Queries of one scan count as one piece of
  /// evidence.
  double upper_95 = std::numeric_limits<double>::quiet_NaN();
};

/// Whether protection levels hold, and whether they are of use.
struct Integrity {
  /// Share of the `ok` answers with an error beyond its level on any of the four axes.
  BoundedRate misleading;
  /// Share of the `ok` answers with an error beyond the alert limit on an axis whose level is
  /// inside.
  BoundedRate hazardous;
  /// Share of all queries that are `ok` with every level inside its alert limit.
  BoundedRate availability;
  double availability_lower_95 = std::numeric_limits<double>::quiet_NaN();
  /// Median over `ok` answers of horizontal level over horizontal error; infinite where half of
  /// them have no level, NaN where there is none.
  double level_over_error = std::numeric_limits<double>::quiet_NaN();
};

/// What came out for one prior error. Errors are those of answers that were not `lost`, after the
/// constant bias between reference and map was taken out (see `evaluate_localization`); NaN when
/// there is none.
struct LocalizationLevel {
  /// As asked for; the medians over the queries with `kPrevious`; NaN without priors.
  PriorError prior_error;
  std::size_t queries = 0;
  /// Share of all queries that were not `lost` and are within 0.2 m and 1 deg.
  double success_rate = 0.0;
  /// 95 % interval of it: percentiles of 2,000 resamplings of the scans (trials of a scan stay
  /// together).
  std::array<double, 2> success_interval{};
  std::size_t ok = 0, degraded = 0, lost = 0;
  /// Share of all queries that were `ok` and off by more than 0.5 m or 2 deg.
  double false_ok_rate = 0.0;
  struct Error {
    double median = 0.0;
    double p95 = 0.0;
    /// Root mean square of the horizontal part (x and y in the lidar frame), or of the yaw.
    double rmse_part = 0.0;
  };
  Error translation_m;
  Error rotation_deg;
  struct Time {
    double p50 = 0.0;
    double p95 = 0.0;
  };
  /// Of `Aligner::align`, down-sampling included, reading and deskewing not: CPU clock of the
  /// thread, wall clock.
  Time cpu_ms;
  Time wall_ms;
  /// Squared error in units of the answer's covariance (6 degrees of freedom, so 6 is honest), and
  /// the share below the 95 % point 12.59. NaN for a method that gives no covariance.
  double nees_mean = 0.0;
  double nees_inside_95 = 0.0;
  Integrity integrity;
  /// How often each reason was given.
  std::map<localization::Reason, std::size_t> reasons;
};

struct LocalizationEvaluation {
  std::vector<LocalizationLevel> levels;
  /// Of each level, in the order of scans and then trials.
  std::vector<std::vector<LocalizationQuery>> queries;
  /// That were asked for.
  std::size_t scans = 0;
  QueryPoints points;
  double seconds = 0.0;
  LocalizationEvaluationOptions options;
};

/// Asks for the pose of each selected scan from priors with known errors, and compares with the
/// drive's poses, or with `options.reference`.
///
/// Unless `query_deskew` says otherwise a query is deskewed with the vehicle's own velocity
/// (`twist_at`, from the drive's poses before and after), because a vehicle knows it from its
/// wheels; without neighbouring poses it is matched as it is. The constant bias (map and reference
/// disagree about where the sensor sits) is one SE(3) in the lidar frame, the medians of the six
/// components of log(T_reference^-1 T_answer): fitted on every other scan and applied to the rest,
/// and the other way round, so that no answer is judged with a bias that it helped to fit. With
/// fewer than two scans, or `BiasCorrection:: kNone`, no bias is taken out.
/// @throws std::invalid_argument (options, no poses to compare with, no scan to ask for, an unknown
/// detector), maps::InputError,
///         maps::StorageError, Cancelled, and what the factory throws.
/// @note   Everything but the times is the same for any number of threads.
[[nodiscard]] LocalizationEvaluation evaluate_localization(
    const maps::MapPackage& map, const maps::Drive& drive,
    const LocalizationEvaluationOptions& options, const AlignerFactory& make_aligner,
    const ProgressCallback& progress, const CancelFlag& cancel);

/// The object of `--json`, without the keys that only the program knows (`version`, paths, method):
/// `levels[]`, `scans`, `points` {in, projected, deleted, without_ground},
/// `seconds`, `options`. NaN becomes null.
[[nodiscard]] std::string to_json(const LocalizationEvaluation& evaluation);

/// The table of `--csv`: a line of column names, then one a query. Reasons are joined by `|`;
/// a field is empty where there is no such number (the error of a lost answer, an infinite level).
[[nodiscard]] std::string to_csv(const LocalizationEvaluation& evaluation);

}  // namespace stillmap::mapping

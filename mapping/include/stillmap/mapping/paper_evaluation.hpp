#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/cleaning.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/map_package.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// What the paper's Table II is made of.
struct PaperEvaluationOptions {
  /// Streets to simulate, one a seed, no one twice; not empty unless `drives` are given. Fewer than
  /// three say little of other streets.
  std::vector<std::uint64_t> seeds = {101, 102, 103};
  /// Of each day of a simulated street, in [3, 10000].
  std::size_t scans = 100;
  /// Of a simulated street, as `SimulationOptions::sensor`.
  std::string sensor = "hdl64";
  /// Of a simulated street, as `SimulationOptions::parked_share`.
  std::optional<double> parked_share;
  /// Instead of simulated streets: the drive that the maps are made of, and the one that is asked
  /// for in them, with poses in one frame that are taken for the truth.
  std::vector<std::array<std::filesystem::path, 2>> drives;
  /// What finds movable objects in both days: a name for `make_detector`, or `boxes`, the drives'
  /// own boxes.json (true boxes, where a drive is simulated).
  std::string detector = "geometric";
  /// Names out of `paper_map_names`; empty = all.
  std::vector<std::string> maps;
  /// Names that the aligner factory knows; not empty.
  std::vector<std::string> methods = {"icp", "default"};
  /// Threads, 0 = all cores. The figures do not depend on it.
  int threads = 0;
  /// Which program this is; pieces that another one made are not used again.
  std::string program;

  /// Every broken bound as "name: value, bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// What the evaluation needs of other libraries.
struct PaperParts {
  /// A town street on day 1 or 2.
  struct StreetDay {
    std::uint64_t seed = 0;
    int day = 1;
  };
  /// Writes a drive, whole or not at all, to a folder that does not exist, with boxes.json and
  /// exact poses in one frame for both days.
  using Simulate = std::function<void(const PaperEvaluationOptions& options, StreetDay street,
                                      const std::filesystem::path& target,
                                      const ProgressCallback& progress, const CancelFlag& cancel)>;
  using MakeAligner = std::function<std::unique_ptr<localization::Aligner>(
      std::string_view method, const maps::MapPackage& map)>;

  Simulate simulate;
  MakeAligner make_aligner;
  CleanerFactory make_cleaner;
  /// Reference methods that the factory knows, without `none`.
  std::vector<std::string> cleaners;
};

/// Names of the maps that are compared, in the order of the table:
///  - `none`: nothing removed, nothing cleaned;
///  - `deletion`: as `paper`, but what is in a box is deleted instead of projected;
///  - each of `cleaners`: a published method without a detector;
///  - `paper`: the paper's method (`apply_paper_preset`), its projected points matched like all
///    others, since a map that is a plain cloud cannot tell them apart;
///  - `ours`: our defaults; moved and filled points are marked, and never matched;
///  - `ours-all`: the same map with moved and filled points matched like all others.
[[nodiscard]] std::vector<std::string> paper_map_names(const std::vector<std::string>& cleaners);

/// A figure with its 95 % confidence interval; NaN where there is none.
struct Interval {
  double value = 0.0;
  double low = 0.0;
  double high = 0.0;
};

/// The answer for one scan of day 2.
struct PaperAnswer {
  /// Index in the drive.
  std::size_t scan = 0;
  localization::PoseStatus status = localization::PoseStatus::kLost;
  /// How far the answer is off in x and y together [m], and in yaw [rad, >= 0]; of a lost one how
  /// far its prior is.
  double xy_m = 0.0;
  double yaw_rad = 0.0;
  /// Not lost, and within 0.2 m and 1 deg.
  bool success = false;
};

/// All answers of one method in one map of one street.
struct PaperAnswers {
  std::vector<PaperAnswer> scans;
  /// Digest of the map, and its points by kind.
  std::string map_digest;
  std::uint64_t measured = 0, projected = 0, filled = 0;
  /// Points of the scans, and how many of them were deleted.
  std::uint64_t query_points = 0, query_deleted = 0;
  /// Median CPU time of an answer.
  double cpu_ms = 0.0;
};

/// One line of the table: a method asked with raw scans, or with scans without movable objects.
struct PaperRow {
  std::string method;
  /// `raw` or `removed`.
  std::string query;
  std::string map;
  /// In the order of the streets.
  std::vector<PaperAnswers> streets;

  std::size_t queries = 0, degraded = 0, lost = 0;
  Interval success_rate;
  /// Root mean square over all scans, lost ones with their prior's error.
  Interval rmse_xy_m;
  Interval rmse_yaw_rad;
  /// Over the answers that are not lost; NaN when there is none.
  double answered_rmse_xy_m = 0.0;
  double answered_rmse_yaw_rad = 0.0;
};

/// By how much one map's errors differ from another's, of the same scans from the same priors.
struct PaperDifference {
  std::string method;
  std::string query;
  std::string map;
  std::string against;
  /// RMSE of `map` less that of `against`: below zero = `map` is better.
  Interval rmse_xy_m;
  Interval rmse_yaw_rad;
  /// Streets in which `map` has the smaller RMSE, of all.
  std::size_t better_xy = 0, better_yaw = 0, streets = 0;
};

struct PaperEvaluation {
  /// Of seeds "seed 101", of drives "drive 1".
  std::vector<std::string> streets;
  /// By method, query and map.
  std::vector<PaperRow> rows;
  /// Every map against `none`, then what projection alone does: `paper` against `deletion` and
  /// `ours-all` against `ours`; those whose maps were made.
  std::vector<PaperDifference> differences;
  /// Scans that were asked for, of all streets.
  std::size_t scans = 0;
  double seconds = 0.0;
  PaperEvaluationOptions options;
};

/// The paper's Table II (Woo, Jung, Kim, "No More Potentially Dynamic Objects", section IV): maps
/// of day 1 made in several ways, and the poses of day 2's scans in them, each from the true pose
/// of the scan before. Scans are asked for as they are, and with movable objects deleted, as the
/// paper did.
///
/// Where we depart from the paper: its RMSE is of the motion between scans k and k + 1, ours of
/// the pose at k + 1, which is the same, since the pose at k is the true one. An answer that is
/// lost counts with its prior's error, and is counted: leaving it out would reward a method that
/// gives up where it is hard. Intervals: see `StreetDraws`.
///
/// Drives, maps and answers lie in `work` under names that hold a checksum of everything they come
/// from; what is there and whole is used again, what is broken is made again.
/// @param work  a folder; made if it is not there.
/// @param keep  maps too are left there; else each goes as soon as its answers are there.
/// @throws std::invalid_argument (options, parts), and what simulating, building and localizing
/// throw.
[[nodiscard]] PaperEvaluation evaluate_paper(const PaperEvaluationOptions& options,
                                             const PaperParts& parts,
                                             const std::filesystem::path& work, bool keep,
                                             const ProgressCallback& progress,
                                             const CancelFlag& cancel);

/// The object of `--json`, without the keys that only the program knows (`version`):
///  - `table[]`: `method`, `query` (raw, removed), `map`, `queries`, `status` {ok, degraded, lost},
///    `success_rate`, `success_interval_95`, `rmse_xy_m`, `rmse_xy_interval_95`, `rmse_yaw_rad`,
///    `rmse_yaw_interval_95`, `rmse_yaw_deg`, `answered` {rmse_xy_m, rmse_yaw_rad}, `cpu_ms`,
///    `streets[]` {name, rmse_xy_m, rmse_yaw_rad, lost, map_digest, map_points {measured,
///    projected, filled}, query_points, query_deleted};
///  - `differences[]`: `method`, `query`, `map`, `against`, `rmse_xy_m`, `rmse_xy_interval_95`,
///    `rmse_yaw_rad`, `rmse_yaw_interval_95`, `better_streets` {xy, yaw, of};
///  - `scans`, `seconds`, `options`.
/// NaN becomes null.
[[nodiscard]] std::string to_json(const PaperEvaluation& evaluation);

/// A page of `--report`: one HTML file that needs no other, without scripts.
/// @param command  how to make it again.
[[nodiscard]] std::string to_html(const PaperEvaluation& evaluation, const std::string& command);

}  // namespace stillmap::mapping

#include <stillmap/mapping/label_evaluation.hpp>

#include <stillmap/maps/peak_memory.hpp>

#include "evaluation/labels/before_and_after.hpp"
#include "evaluation/labels/class_tally.hpp"
#include "evaluation/labels/footprints.hpp"
#include "evaluation/labels/labelled_scans.hpp"
#include "evaluation/labels/removed_points.hpp"
#include "evaluation/labels/thinned_map.hpp"
#include "evaluation/labels/voxel_means.hpp"
#include "evaluation/published_metrics.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

using Clock = std::chrono::steady_clock;
using Depth = LabelledScans::Depth;

constexpr double kPathReachM = 25.0;
constexpr double kBesideFootprintM = 0.3;

/// Tag of a removed point: its class, and what it counts for.
constexpr std::uint16_t kNearTag = 0x100;
constexpr std::uint16_t kHighTag = 0x200;

std::uint16_t tag_of(const LabelledScan& scan, std::size_t i) {
  std::uint16_t tag = scan.classes[i];
  if (scan.is_near[i] != 0) tag |= kNearTag;
  if (scan.heights_m[i] > kParkedHeightM) tag |= kHighTag;
  return tag;
}

void add(ClassTally& tally, std::uint16_t tag, unsigned met) {
  tally.add(static_cast<ClassIndex>(tag & 0xFFU), (tag & kNearTag) != 0, (tag & kHighTag) != 0,
            met);
}

/// Runs through the parts of an evaluation; each of them reads the scans once.
class LabelJudge {
 public:
  LabelJudge(const maps::MapPackage& map, const maps::Drive& drive, bool draw,
             const ProgressCallback& progress, const CancelFlag& cancel)
      : map_(map),
        progress_(progress),
        cancel_(cancel),
        truth_(drive),
        scans_(map, drive, truth_),
        several_drives_(map.trajectories().size() > 1) {
    if (draw) pictures_.emplace(map);
  }

  LabelEvaluation judge() {
    const Clock::time_point began = Clock::now();
    result_.scans = scans_.size();
    result_.drive_in_map = scans_.drive_in_map();
    result_.drives = map_.trajectories().size();
    find_true_ground();
    judge_points();
    judge_heights();
    if (scans_.drive_in_map()) {
      judge_removed();
      judge_uncleaned();
    }
    collect();
    result_.peak_rss_mib = maps::peak_rss_mib();
    result_.seconds = std::chrono::duration<double>(Clock::now() - began).count();
    return std::move(result_);
  }

 private:
  template <typename Visit>
  void for_each_scan(std::string_view stage, Depth depth, const Visit& visit) {
    const Clock::time_point began = Clock::now();
    for (std::size_t i = 0; i < scans_.size(); ++i) {
      if (cancel_) throw Cancelled();
      visit(scans_.read(i, depth));
      if (progress_) progress_(stage, i + 1, scans_.size());
    }
    end_stage(stage, began);
  }

  void end_stage(std::string_view stage, Clock::time_point began) {
    result_.stage_seconds.emplace_back(stage,
                                       std::chrono::duration<double>(Clock::now() - began).count());
  }

  void find_true_ground() {
    footprints_ = footprints_of(map_.objects(), map_.manifest().origin);
    for (const maps::MapObject& object : map_.objects()) {
      if (object.points_removed == 0) continue;
      ++(object.motion == maps::ObjectMotion::kMoving ? result_.moving_objects
                                                      : result_.parked_objects);
    }
    if (truth_.has_surface()) {
      result_.true_ground = TrueGround::kSurface;
      std::vector<Eigen::Vector3f> path;
      std::vector<Eigen::Isometry3d> T_truth_map;
      for (std::size_t i = 0; i < scans_.size(); ++i) {
        path.emplace_back(
            (scans_.T_map_lidar(i).translation() - map_.manifest().origin).cast<float>());
        T_truth_map.push_back(scans_.T_truth_map(i));
      }
      heights_.emplace(truth_, map_.manifest().origin, std::move(path), std::move(T_truth_map));
      thinned_cells_.emplace(footprints_, *heights_);
      unthinned_cells_ = thinned_cells_;
    } else if (!truth_.labelled_ground().empty()) {
      result_.true_ground = TrueGround::kLabels;
    }
  }

  /// Points of the package that are part of the unthinned map: what was filled, and what other
  /// drives gave.
  template <typename Visit>
  void for_each_unthinned_of_package(const Visit& visit) const {
    for_each_point(map_, [&](const Eigen::Vector3f& p, maps::PointKind kind) {
      if (several_drives_ || kind == maps::PointKind::kFilled) visit(p, kind);
    });
  }

  /// Points of a scan that are in the unthinned map, where they are there.
  template <typename Visit>
  void for_each_unthinned(const LabelledScan& scan, const Visit& visit) const {
    for (std::size_t i = 0; i < scan.size(); ++i) {
      if (scan.in_map[i] == InMap::kMeasured) {
        visit(scan.positions[i],
              scan.is_ground[i] != 0 ? maps::PointKind::kGround : maps::PointKind::kMeasured);
      } else if (scan.in_map[i] == InMap::kProjected) {
        if (const auto landing = thinned_->landing_of(scan.positions[i]))
          visit(*landing, maps::PointKind::kProjected);
      }
    }
  }

  void add_ground_cell(std::optional<FootprintGround>& cells, const Eigen::Vector3f& p,
                       maps::PointKind kind) {
    if (!cells || kind == maps::PointKind::kMeasured) return;
    cells->add(p.cast<double>(), kind == maps::PointKind::kFilled, *heights_);
  }

  /// The thinned map's figures, the truth side of PR and RR, ground, and which points are gone.
  void judge_points() {
    thinned_.emplace(map_);
    VoxelMeans unthinned(kErasorVoxelM);
    ErasorTruth erasor;
    const auto into_unthinned = [&](const Eigen::Vector3f& p, maps::PointKind kind) {
      unthinned.add(p);
      add_ground_cell(unthinned_cells_, p, kind);
    };
    for_each_scan("points", Depth::kAll, [&](const LabelledScan& scan) {
      count_points(scan);
      add_to(erasor, scan);
      if (pictures_) pictures_->add_scan(scan.positions);
      if (scans_.drive_in_map()) for_each_unthinned(scan, into_unthinned);
    });
    const Clock::time_point began = Clock::now();
    for_each_point(map_, [&](const Eigen::Vector3f& p, maps::PointKind kind) {
      add_ground_cell(thinned_cells_, p, kind);
    });
    score(erasor, package_means(), erasor_thinned_);
    if (scans_.drive_in_map()) {
      for_each_unthinned_of_package(into_unthinned);
      score(erasor, unthinned.take(), erasor_unthinned_);
    }
    end_stage("voxels", began);
  }

  void count_points(const LabelledScan& scan) {
    std::vector<std::uint8_t> met(scan.size());
    tbb::parallel_for(std::size_t{0}, scan.size(), [&](std::size_t i) {
      met[i] = static_cast<std::uint8_t>(thinned_->met(scan.positions[i]));
    });
    for (std::size_t i = 0; i < scan.size(); ++i) {
      const std::uint16_t tag = tag_of(scan, i);
      const bool ignored = semantic_classes()[scan.classes[i]].kind == ClassKind::kIgnored;
      add(thinned_tally_, tag, met[i]);
      if (scan.in_map[i] == InMap::kMeasured) {
        add(unthinned_tally_, tag, RemovedPoints::kAll);
      } else if (scans_.drive_in_map() && !ignored) {
        removed_.add(scan.positions[i], tag);
      }
      result_.ignored += ignored ? 1 : 0;
      count_ground(scan, i);
    }
    result_.points += scan.size();
    result_.dropped += scan.dropped;
  }

  void count_ground(const LabelledScan& scan, std::size_t i) {
    const GroundTruth truth = ground_truth(scan.classes[i]);
    if (truth == GroundTruth::kLeftOut) return;
    const bool found = scan.is_ground[i] != 0;
    if (truth == GroundTruth::kGround)
      ++(found ? ground_.true_positives : ground_.false_negatives);
    else if (found)
      ++ground_.false_positives;
  }

  static void add_to(ErasorTruth& erasor, const LabelledScan& scan) {
    std::vector<Eigen::Vector3f> positions;
    std::vector<std::uint8_t> kinds;
    positions.reserve(scan.size());
    kinds.reserve(scan.size());
    for (std::size_t i = 0; i < scan.size(); ++i) {
      if (semantic_classes()[scan.classes[i]].kind == ClassKind::kIgnored) continue;
      positions.push_back(scan.positions[i]);
      kinds.push_back(scan.classes[i]);
    }
    erasor.add_scan(scan.sensor, positions, kinds);
  }

  [[nodiscard]] std::vector<Eigen::Vector3f> package_means() const {
    VoxelMeans voxels(kErasorVoxelM);
    for_each_point(map_, [&](const Eigen::Vector3f& p, maps::PointKind) { voxels.add(p); });
    return voxels.take();
  }

  static void score(const ErasorTruth& truth, const std::vector<Eigen::Vector3f>& map_means,
                    std::array<ErasorScores, 2>& scores) {
    scores = {truth.scores(map_means, dynamic_kinds(TruthClasses::kMoving)),
              truth.scores(map_means, dynamic_kinds(TruthClasses::kMovable))};
  }

  void judge_heights() {
    if (!heights_) return;
    const Clock::time_point began = Clock::now();
    const FootprintIndex index(footprints_);
    std::vector<std::uint8_t> across(footprints_.size());
    tbb::parallel_for(std::size_t{0}, across.size(), [&](std::size_t i) {
      across[i] = is_across_step(footprints_[i], *heights_) ? 1 : 0;
    });
    std::vector<double> all, projected, filled, one_surface, across_kerb;
    for_each_point(map_, [&](const Eigen::Vector3f& point, maps::PointKind kind) {
      if (maps::is_measured(kind)) return;
      const Eigen::Vector3d p = point.cast<double>();
      if (!(heights_->path_distance(p) <= kPathReachM)) return;
      const auto over = heights_->over_surface(p);
      if (!over) return;
      bool at_kerb = false;
      index.for_each_at(p.head<2>(), kBesideFootprintM,
                        [&](std::size_t i) { at_kerb = at_kerb || across[i] != 0; });
      all.push_back(*over);
      (kind == maps::PointKind::kFilled ? filled : projected).push_back(*over);
      (at_kerb ? across_kerb : one_surface).push_back(*over);
    });
    result_.heights =
        GroundHeights{height_errors(std::move(all)), height_errors(std::move(projected)),
                      height_errors(std::move(filled)), height_errors(std::move(one_surface)),
                      height_errors(std::move(across_kerb))};
    end_stage("heights", began);
  }

  /// What the removed points still meet in the unthinned map.
  void judge_removed() {
    removed_.sort();
    const auto meet = [this](const Eigen::Vector3f& p, maps::PointKind kind) {
      removed_.meet(p, maps::is_measured(kind));
    };
    for_each_scan("removed", Depth::kPlaces,
                  [&](const LabelledScan& scan) { for_each_unthinned(scan, meet); });
    for_each_unthinned_of_package(meet);
    for (const RemovedPoints::Point& point : removed_.points())
      add(unthinned_tally_, point.tag, point.met);
    removed_ = {};
    thinned_.reset();
  }

  /// What the map of the same voxels that holds everything would have lost.
  void judge_uncleaned() {
    VoxelMeans voxels(map_.manifest().voxel_size_m);
    for_each_scan("uncleaned", Depth::kPositions, [&](const LabelledScan& scan) {
      for (const Eigen::Vector3f& p : scan.positions) voxels.add(p);
    });
    if (several_drives_) {
      for_each_point(map_, [&](const Eigen::Vector3f& p, maps::PointKind kind) {
        if (maps::is_measured(kind)) voxels.add(p);
      });
    }
    constexpr double kNearM = RemovedPoints::kNearM;
    const PointCells means(voxels.take(), kNearM);
    for_each_scan("compared", Depth::kPositions, [&](const LabelledScan& scan) {
      std::vector<std::uint8_t> lost(scan.size());
      tbb::parallel_for(std::size_t{0}, scan.size(), [&](std::size_t i) {
        // What moves is static in neither set of classes.
        const ClassKind kind = semantic_classes()[scan.classes[i]].kind;
        const bool counts = kind == ClassKind::kStays || kind == ClassKind::kParked;
        lost[i] = counts && !means.any_within(scan.positions[i], kNearM) ? 1 : 0;
      });
      for (std::size_t i = 0; i < scan.size(); ++i) {
        ClassCounts& counts = uncleaned_tally_.by_class[scan.classes[i]];
        ++counts.points;
        counts.lost += lost[i];
      }
    });
  }

  void collect() {
    if (pictures_) result_.pictures = pictures_->finish();
    result_.thinned = figures_of(thinned_tally_, uncleaned_tally_, erasor_thinned_, thinned_cells_);
    if (!scans_.drive_in_map()) return;
    // The unthinned map that holds everything loses nothing.
    result_.unthinned = figures_of(unthinned_tally_, {}, erasor_unthinned_, unthinned_cells_);
    result_.ground = ground_;
  }

  static MapFigures figures_of(const ClassTally& tally, const ClassTally& uncleaned,
                               const std::array<ErasorScores, 2>& erasor,
                               const std::optional<FootprintGround>& cells);
  static MapScores scores_of(const ClassTally& tally, const ClassTally& uncleaned,
                             const ErasorScores& erasor, TruthClasses classes);

  const maps::MapPackage& map_;
  const ProgressCallback& progress_;
  const CancelFlag& cancel_;
  DriveTruth truth_;
  LabelledScans scans_;
  bool several_drives_;
  LabelEvaluation result_;
  std::optional<BeforeAndAfter> pictures_;
  std::vector<Footprint> footprints_;
  std::optional<TrueHeights> heights_;
  std::optional<FootprintGround> thinned_cells_, unthinned_cells_;
  std::optional<ThinnedMap> thinned_;
  ClassTally thinned_tally_, unthinned_tally_, uncleaned_tally_;
  std::array<ErasorScores, 2> erasor_thinned_, erasor_unthinned_;
  GroundScores ground_;
  RemovedPoints removed_;
};

/// The first less the second; a second one that was not counted is nothing.
double loss_of(const Share& lost, const Share& uncleaned) {
  return lost.rate() - (uncleaned.of == 0 ? 0.0 : uncleaned.rate());
}

MapScores LabelJudge::scores_of(const ClassTally& tally, const ClassTally& uncleaned,
                                const ErasorScores& erasor, TruthClasses classes) {
  const BenchmarkScores measured = benchmark_scores(tally.benchmark(classes, true));
  const BenchmarkCounts plain = tally.benchmark(classes, false);
  MapScores scores;
  scores.static_kept = {measured.static_kept, measured.truth_static};
  scores.dynamic_removed = {measured.dynamic_removed, measured.truth_dynamic};
  scores.plain_removed = {plain.dynamic_removed, plain.truth_dynamic};
  scores.SA = measured.SA;
  scores.DA = measured.DA;
  scores.AA = measured.AA;
  scores.HA = measured.HA;
  scores.static_voxels_kept = {erasor.static_kept, erasor.truth_static};
  scores.dynamic_voxels_kept = {erasor.dynamic_kept, erasor.truth_dynamic};
  scores.PR = erasor.PR;
  scores.RR = erasor.RR;
  scores.F1 = erasor.F1;
  scores.static_lost = tally.lost(classes);
  scores.static_lost_uncleaned = uncleaned.lost(classes);
  scores.static_loss = loss_of(scores.static_lost, scores.static_lost_uncleaned);
  return scores;
}

MapFigures LabelJudge::figures_of(const ClassTally& tally, const ClassTally& uncleaned,
                                  const std::array<ErasorScores, 2>& erasor,
                                  const std::optional<FootprintGround>& cells) {
  MapFigures figures;
  figures.scores = {scores_of(tally, uncleaned, erasor[0], TruthClasses::kMoving),
                    scores_of(tally, uncleaned, erasor[1], TruthClasses::kMovable)};
  figures.parked_removed = tally.parked;
  if (cells) {
    figures.ground_under = cells->all();
    figures.ground_bands = cells->bands();
  }
  for (std::size_t i = 0; i < semantic_classes().size(); ++i) {
    const SemanticClass& semantic = semantic_classes()[i];
    const ClassCounts& counts = tally.by_class[i];
    if (semantic.kind != ClassKind::kStays || counts.points == 0) continue;
    const Share lost{counts.lost, counts.points};
    const Share base{uncleaned.by_class[i].lost, uncleaned.by_class[i].points};
    figures.losses.push_back(
        {semantic.label, std::string(semantic.name), lost, base, loss_of(lost, base)});
  }
  return figures;
}

}  // namespace

LabelEvaluation evaluate_with_labels(const maps::MapPackage& map, const maps::Drive& drive,
                                     bool draw, const ProgressCallback& progress,
                                     const CancelFlag& cancel) {
  return LabelJudge(map, drive, draw, progress, cancel).judge();
}

}  // namespace stillmap::mapping

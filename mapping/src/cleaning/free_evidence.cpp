#include "cleaning/free_evidence.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace stillmap::mapping {
namespace {

constexpr double kKeyframeStepM = 0.7;
constexpr double kKeyframeTurnRad = 0.17;
constexpr std::size_t kKeyframeScans = 20;
/// Half a step: rays of the same place meet the same side of everything.
constexpr double kSamePlaceM = 0.35;
constexpr float kSamePlaceWeight = 0.25F;

/// Nearer than this a view meets its own vehicle [m].
constexpr float kNearestM = 2.0F;
/// Views that a cell is given for granted not to have moved.
constexpr float kDoubtfulShare = 2.0F;
/// What a thin thing lets through of the rays that head for its cell.
constexpr double kLetsThrough = 0.85;

/// A run counts without a second place when this many views follow each other (10 s) and nothing
/// was ever said about the cell from elsewhere: then what hit it was seen from the same place, so
/// no fence stands before some views and not before others.
constexpr std::uint32_t kLongRunViews = 5;

/// Most cells are walls and the like: hit by every view, seen free by none. So every fourth view is
/// asked first, and cells that are hit by this many of them, and free to none, are left alone.
constexpr std::size_t kFirstStep = 4;
constexpr float kSurelyHit = 3.0F;

/// A hit so many places after the last one is of another pass: 40 m of way and more.
constexpr std::uint32_t kPassPlaces = 60;

/// All that the views before the current one said about a cell.
struct Record {
  float spoken = 0.0F;  ///< free, hit and mixed
  float run = 0.0F;     ///< free since the last hit
  float best_run = 0.0F;
  float hits = 0.0F;
  bool ever_free = false;
  std::uint32_t first_place = 0;  ///< of the run
  bool several_places = false;    ///< in the run

  /// The same for a cell that one place alone spoke of, where each view weighs as much as the
  /// first: they differ in time.
  std::uint32_t only_place = 0;
  bool elsewhere = false;
  float timed_spoken = 0.0F, timed_run = 0.0F, best_timed_run = 0.0F;
  std::uint32_t run_views = 0;

  /// Stretches of the way from which it was hit.
  std::uint32_t passes = 0;
  std::uint32_t last_hit_place = 0;

  [[nodiscard]] float score() const {
    if (!elsewhere) return best_timed_run / (kDoubtfulShare + timed_spoken);
    return best_run / (kDoubtfulShare + spoken) / static_cast<float>(std::max(passes, 1U));
  }
};

constexpr int kMostRays = 63;
using Weights = std::array<float, kMostRays + 1>;

/// By the number of rays.
Weights free_weights() {
  Weights weights;
  for (std::size_t rays = 0; rays < weights.size(); ++rays)
    weights[rays] = static_cast<float>(1.0 - std::pow(kLetsThrough, static_cast<double>(rays)));
  return weights;
}

/// @param seen  1, or less for a free view with few rays.
void add_spoken(Record& record, const Keyframe& keyframe, float seen) {
  if (record.timed_spoken <= 0.0F) record.only_place = keyframe.place;
  if (keyframe.place != record.only_place) record.elsewhere = true;
  record.spoken += keyframe.weight * seen;
  record.timed_spoken += seen;
}

void add_free(Record& record, const Keyframe& keyframe, float seen) {
  if (record.run <= 0.0F) {
    record.first_place = keyframe.place;
    record.several_places = false;
    record.timed_run = 0.0F;
    record.run_views = 0;
  }
  record.run += keyframe.weight * seen;
  record.timed_run += seen;
  record.ever_free = true;
  add_spoken(record, keyframe, seen);
  if (keyframe.place != record.first_place) record.several_places = true;
  if (record.several_places) record.best_run = std::max(record.best_run, record.run);
  if (++record.run_views >= kLongRunViews)
    record.best_timed_run = std::max(record.best_timed_run, record.timed_run);
}

/// What a view says about a cell, in a byte: nothing, hit, mixed, or free with so many rays.
enum : std::uint8_t { kNothing = 0, kHit = 1, kMixed = 2, kFreeFrom = 3 };

std::uint8_t byte_of(const Look& look) {
  switch (look.sight) {
    case Sight::kUnknown:
    case Sight::kHidden:
      return kNothing;
    case Sight::kHit:
      return kHit;
    case Sight::kMixed:
      return kMixed;
    case Sight::kFree:
      return static_cast<std::uint8_t>(kFreeFrom + std::min(look.rays, kMostRays));
  }
  return kNothing;
}

void add(Record& record, std::uint8_t said, const Keyframe& keyframe, const Weights& weights) {
  if (said == kNothing) return;
  if (said == kHit) {
    record.run = 0.0F;
    record.hits += keyframe.weight;
    if (record.passes == 0 || keyframe.place > record.last_hit_place + kPassPlaces) ++record.passes;
    record.last_hit_place = keyframe.place;
    add_spoken(record, keyframe, 1.0F);
  } else if (said == kMixed) {
    add_spoken(record, keyframe, 1.0F);
  } else {
    add_free(record, keyframe, weights[said - kFreeFrom]);
  }
}

/// Asks views about cells.
struct Asker {
  std::span<const Eigen::Vector3f> positions;
  float radius_m;
  const PosedViews& views;

  /// What a view says about each of some cells; nothing at all when it is too far from all of them.
  /// @param cells  numbers in `positions`. @param bounds  of their positions.
  [[nodiscard]] std::vector<std::uint8_t> ask(std::span<const std::uint32_t> cells,
                                              const Eigen::AlignedBox3f& bounds,
                                              std::size_t scan) const {
    const Eigen::Isometry3d& T = views.T_local_lidar[scan];
    const Eigen::Vector3f sensor = T.translation().cast<float>();
    if (!(bounds.squaredExteriorDistance(sensor) < kViewReachM * kViewReachM)) return {};
    std::vector<std::uint8_t> said(cells.size(), kNothing);
    const std::shared_ptr<const RangeView> view = views.read(scan);
    const Eigen::Isometry3f T_lidar_local = T.inverse().cast<float>();
    const maps::PoseDisagreement doubt =
        views.doubts.empty() ? maps::PoseDisagreement{} : views.doubts[scan];
    for (std::size_t k = 0; k < cells.size(); ++k) {
      const Eigen::Vector3f p = T_lidar_local * positions[cells[k]];
      const float range2 = p.squaredNorm();
      if (range2 > kViewReachM * kViewReachM || range2 < kNearestM * kNearestM) continue;
      said[k] = byte_of(view->look(p, radius_m, doubt.at(std::sqrt(range2))));
    }
    return said;
  }
};

}  // namespace

std::vector<Keyframe> select_keyframes(std::span<const Eigen::Isometry3d> T_local_lidar) {
  std::vector<Keyframe> keyframes;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < T_local_lidar.size(); ++i) {
    const Eigen::Isometry3d& T = T_local_lidar[i];
    if (keyframes.empty()) {
      keyframes.push_back({i, 0, 1.0F});
      place = T.translation();
      continue;
    }
    const Keyframe& last = keyframes.back();
    const Eigen::Isometry3d T_last_this = T_local_lidar[last.scan].inverse() * T;
    const double turn = Eigen::AngleAxisd(T_last_this.linear()).angle();
    if (T_last_this.translation().norm() < kKeyframeStepM && turn < kKeyframeTurnRad &&
        i - last.scan < kKeyframeScans)
      continue;
    const bool same = (T.translation() - place).norm() < kSamePlaceM;
    if (!same) place = T.translation();
    keyframes.push_back({i, same ? last.place : last.place + 1, same ? kSamePlaceWeight : 1.0F});
  }
  return keyframes;
}

std::vector<FreeEvidence> find_free_evidence(std::span<const Eigen::Vector3f> positions,
                                             float radius_m, const PosedViews& views,
                                             std::span<const Keyframe> keyframes) {
  static const Weights weights = free_weights();
  std::vector<FreeEvidence> evidence(positions.size());
  std::vector<std::uint32_t> cells(positions.size());
  std::iota(cells.begin(), cells.end(), 0U);
  Eigen::AlignedBox3f bounds;
  for (const Eigen::Vector3f& p : positions) bounds.extend(p);
  const Asker asker{positions, radius_m, views};
  std::vector<Record> records(cells.size());
  // By every fourth view; empty for those that say nothing.
  std::vector<std::vector<std::uint8_t>> said_first;
  for (std::size_t k = 0; k < keyframes.size(); k += kFirstStep) {
    const auto& said = said_first.emplace_back(asker.ask(cells, bounds, keyframes[k].scan));
    for (std::size_t i = 0; i < said.size(); ++i) add(records[i], said[i], keyframes[k], weights);
  }
  std::vector<std::uint32_t> doubtful;
  Eigen::AlignedBox3f doubtful_bounds;
  for (const std::uint32_t i : cells) {
    if (records[i].hits >= kSurelyHit && !records[i].ever_free) {
      evidence[i].hits = kFirstStep * records[i].hits;
    } else {
      doubtful.push_back(i);
      doubtful_bounds.extend(positions[i]);
    }
  }
  records.assign(doubtful.size(), {});
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    if (k % kFirstStep == 0) {
      const std::vector<std::uint8_t>& said = said_first[k / kFirstStep];
      for (std::size_t i = 0; i < records.size() && !said.empty(); ++i)
        add(records[i], said[doubtful[i]], keyframes[k], weights);
    } else {
      const std::vector<std::uint8_t> said =
          asker.ask(doubtful, doubtful_bounds, keyframes[k].scan);
      for (std::size_t i = 0; i < said.size(); ++i) add(records[i], said[i], keyframes[k], weights);
    }
  }
  for (std::size_t i = 0; i < doubtful.size(); ++i)
    evidence[doubtful[i]] = {records[i].score(), records[i].hits};
  return evidence;
}

}  // namespace stillmap::mapping

#include "fusion/moving.hpp"

#include "fusion/box_estimate.hpp"
#include "fusion/motion_filter.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace stillmap::mapping {
namespace {

/// Scans before the first and after the last box that an object goes on in.
constexpr std::size_t kExtraScans = 3;
/// Above it an object heads where it goes [m/s].
constexpr double kHeadingSpeedMps = 1.5;
/// Centres aligned by the sides that were seen scatter less than the boxes' own.
constexpr double kAlignedSigma = 0.6;
/// Boxes this much off the way they go are of a corner, not of the whole [rad].
constexpr double kMaxOffRad = 0.3;
/// Scans to each side that a heading is averaged over.
constexpr std::size_t kTurnReach = 2;
/// So many hits for so long within so much are of something that stands [s, m].
constexpr std::size_t kMinStandingHits = 4;
constexpr double kMinStandingS = 0.5;
constexpr double kStandingM = 0.8;
/// A place that it moved on from is a new view each time, but boxes of scans in a row have the same
/// faults.
constexpr double kScanWeight = 0.15;
/// A given track may be silent for so long and still be interpolated [s].
constexpr double kMaxInterpolatedS = 2.0;

/// The scans of a track's time, with its hits.
struct Span {
  std::vector<std::size_t> scans;
  /// Index into the track's hits, or none.
  std::vector<std::optional<std::size_t>> hits;
};

Span span_of(const Track& track, const std::vector<std::size_t>& drive_scans) {
  const auto position = [&](std::size_t scan) {
    return static_cast<std::size_t>(std::lower_bound(drive_scans.begin(), drive_scans.end(), scan) -
                                    drive_scans.begin());
  };
  const std::size_t first = position(track.hits.front().scan);
  const std::size_t last = position(track.hits.back().scan);
  const std::size_t begin = first - std::min(first, kExtraScans);
  const std::size_t end = std::min(drive_scans.size(), last + kExtraScans + 1);
  Span span;
  std::size_t next = 0;
  for (std::size_t i = begin; i < end; ++i) {
    span.scans.push_back(drive_scans[i]);
    span.hits.emplace_back();
    if (next < track.hits.size() && track.hits[next].scan == drive_scans[i])
      span.hits.back() = next++;
    // A second box in the same scan adds nothing.
    while (next < track.hits.size() && track.hits[next].scan == drive_scans[i]) ++next;
  }
  return span;
}

std::vector<MotionState> path_of(const Track& track, const Span& span,
                                 const std::vector<DetectedScan>& scans, const maps::Box& whole) {
  std::vector<PathStep> steps;
  const std::int64_t began_ns = scans[span.scans.front()].stamp_ns;
  for (std::size_t i = 0; i < span.scans.size(); ++i) {
    PathStep step;
    step.time_s = static_cast<double>(scans[span.scans[i]].stamp_ns - began_ns) * 1e-9;
    if (i > 0) step.time_s = std::max(step.time_s, steps.back().time_s);
    step.sigma_m = kAlignedSigma * centre_sigma_m(whole.object_class);
    if (span.hits[i]) step.position = aligned_centre(track.hits[*span.hits[i]], whole.size_m);
    steps.push_back(step);
  }
  return smoothed_path(steps, motion_noise_of(whole.object_class));
}

/// Where it goes while it goes fast; before and between, as it went last.
std::vector<double> courses_of(const Track& track, const std::vector<MotionState>& path) {
  const auto is_fast = [](const MotionState& state) {
    return state.velocity_mps.norm() > kHeadingSpeedMps;
  };
  const auto course = [](const MotionState& state) {
    return std::atan2(state.velocity_mps.y(), state.velocity_mps.x());
  };
  const auto fast = std::find_if(path.begin(), path.end(), is_fast);
  double last_rad = fast == path.end() ? track.hits.front().box.yaw_rad : course(*fast);
  std::vector<double> courses;
  for (const MotionState& state : path) {
    if (is_fast(state)) last_rad = course(state);
    courses.push_back(last_rad);
  }
  return courses;
}

/// Heading of each step: its course, turned by what the boxes around it say, of which length and
/// width may be mixed up.
std::vector<double> yaws_of(const Track& track, const Span& span,
                            const std::vector<MotionState>& path) {
  const std::vector<double> courses = courses_of(track, path);
  std::vector<double> yaws = courses;
  for (std::size_t i = 0; i < yaws.size(); ++i) {
    double sum_rad = 0.0;
    int boxes = 0;
    const std::size_t end = std::min(yaws.size(), i + kTurnReach + 1);
    for (std::size_t k = i - std::min(i, kTurnReach); k < end; ++k) {
      if (!span.hits[k]) continue;
      const double off_rad = std::remainder(track.hits[*span.hits[k]].box.yaw_rad - courses[k],
                                            0.5 * std::numbers::pi);
      if (std::abs(off_rad) > kMaxOffRad) continue;
      sum_rad += off_rad;
      ++boxes;
    }
    if (boxes > 0) yaws[i] += sum_rad / boxes;
  }
  return yaws;
}

/// Height of the centre at each step: between the hits, and as at the nearest one outside of them.
std::vector<double> heights_of(const Track& track, const Span& span) {
  std::vector<double> z(span.scans.size());
  std::optional<std::size_t> before;
  for (std::size_t i = 0; i < z.size(); ++i) {
    if (!span.hits[i]) {
      if (before) z[i] = z[*before];
      continue;
    }
    z[i] = track.hits[*span.hits[i]].box.centre.z();
    const std::size_t from = before ? *before : 0;
    if (!before) z[0] = z[i];
    for (std::size_t k = from + 1; k < i; ++k)
      z[k] = z[from] +
             (z[i] - z[from]) * static_cast<double>(k - from) / static_cast<double>(i - from);
    before = i;
  }
  return z;
}

/// Whether a silent step lies too deep in a long silence to say where it was.
bool is_lost(const Track& track, const Span& span, const std::vector<DetectedScan>& scans,
             std::size_t step) {
  std::size_t before = step, after = step;
  while (before > 0 && !span.hits[before]) --before;
  while (after + 1 < span.hits.size() && !span.hits[after]) ++after;
  if (!span.hits[before] || !span.hits[after]) return false;
  const double silent_s =
      static_cast<double>(scans[span.scans[after]].stamp_ns - scans[span.scans[before]].stamp_ns) *
      1e-9;
  const double way_m =
      (track.hits[*span.hits[after]].box.centre - track.hits[*span.hits[before]].box.centre).norm();
  return silent_s > kMaxInterpolatedS && way_m > kStandingM &&
         std::min(step - before, after - step) > kExtraScans;
}

/// The hits at one end of a track while it stood there; none when it came or left in motion.
Track standing_end(const Track& track, const std::vector<DetectedScan>& scans,
                   const Eigen::Vector3d& size_m, bool at_begin) {
  Track end{track.drive, track.given, {}};
  const std::size_t n = track.hits.size();
  const auto hit = [&](std::size_t i) { return track.hits[at_begin ? i : n - 1 - i]; };
  const Eigen::Vector2d place = aligned_centre(hit(0), size_m);
  for (std::size_t i = 0; i < n; ++i) {
    if (!((aligned_centre(hit(i), size_m) - place).norm() < kStandingM)) break;
    end.hits.push_back(hit(i));
  }
  if (!at_begin) std::reverse(end.hits.begin(), end.hits.end());
  const double stood_s = static_cast<double>(scans[end.hits.back().scan].stamp_ns -
                                             scans[end.hits.front().scan].stamp_ns) *
                         1e-9;
  if (end.hits.size() < kMinStandingHits || stood_s < kMinStandingS) end.hits.clear();
  return end;
}

}  // namespace

MovingCase::MovingCase(Track track, const std::vector<DetectedScan>& scans,
                       const std::vector<std::size_t>& drive_scans)
    : track_(std::move(track)) {
  whole_.object_class = class_of(track_.hits);
  whole_.size_m = size_of(track_.hits);
  const Span span = span_of(track_, drive_scans);
  const std::vector<MotionState> path = path_of(track_, span, scans, whole_);
  const std::vector<double> yaws = yaws_of(track_, span, path);
  const std::vector<double> heights = heights_of(track_, span);
  for (std::size_t i = 0; i < span.scans.size(); ++i) {
    ObjectPlacement placement{span.scans[i], whole_, span.hits[i].has_value()};
    if (!placement.detected && is_lost(track_, span, scans, i)) continue;
    double opinion = 0.0;
    if (placement.detected) opinion = log_odds_of(track_.hits[*span.hits[i]].box.score);
    if (track_.given && placement.detected) {
      placement.box = track_.hits[*span.hits[i]].box;
    } else {
      placement.box.centre << path[i].position, heights[i];
      placement.box.yaw_rad = yaws[i];
    }
    placements_.push_back(placement);
    opinions_.push_back(opinion);
  }
  came_from_ = standing_end(track_, scans, whole_.size_m, true);
  stopped_at_ = standing_end(track_, scans, whole_.size_m, false);
}

std::vector<PlaceQuestion> MovingCase::questions() const {
  std::vector<PlaceQuestion> questions;
  for (const ObjectPlacement& placement : placements_)
    questions.push_back({placement.scan, &placement.box});
  return questions;
}

MovingObject MovingCase::concluded(std::span<const PlaceLook> answers) const {
  MovingObject object{whole_, {}, {}};
  const std::size_t first = track_.hits.front().scan, last = track_.hits.back().scan;
  for (std::size_t i = 0; i < placements_.size(); ++i) {
    const ObjectPlacement& placement = placements_[i];
    if (placement.detected) {
      object.evidence.add_hit(kScanWeight, opinions_[i]);
    } else if (placement.scan > first && placement.scan < last) {
      object.evidence.add_silence(kScanWeight, answers[i]);
    }
    const bool was_there = placement.detected || answers[i].state != PlaceState::kFree;
    // Where it stood before it went and after it stopped is told by its standing ends.
    const bool told = (placement.scan < first && !came_from_.hits.empty()) ||
                      (placement.scan > last && !stopped_at_.hits.empty());
    if (was_there && !told) object.placements.push_back(placement);
  }
  return object;
}

void MovingCase::add_standing_end(const StandingObject& stood, bool at_begin,
                                  MovingObject& object) const {
  const std::size_t first = track_.hits.front().scan, last = track_.hits.back().scan;
  for (const auto& [scan, detected] : stood.scans) {
    if (at_begin ? scan < first : scan > last)
      object.placements.push_back({scan, stood.box, false});
  }
  std::sort(object.placements.begin(), object.placements.end(),
            [](const ObjectPlacement& a, const ObjectPlacement& b) { return a.scan < b.scan; });
}

}  // namespace stillmap::mapping

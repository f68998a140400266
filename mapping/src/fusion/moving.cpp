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
    step.sigma_m = centre_sigma_m(whole.object_class);
    if (span.hits[i]) step.position = aligned_centre(track.hits[*span.hits[i]], whole.size_m);
    steps.push_back(step);
  }
  return smoothed_path(steps, motion_noise_of(whole.object_class));
}

/// Heading of each step: where it goes while it goes fast, else as the hits say, undirected ones
/// turned to the heading before.
std::vector<double> yaws_of(const Track& track, const Span& span,
                            const std::vector<MotionState>& path) {
  const std::size_t n = path.size();
  std::vector<std::optional<double>> known(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector2d& v = path[i].velocity_mps;
    if (v.norm() > kHeadingSpeedMps) known[i] = std::atan2(v.y(), v.x());
  }
  std::optional<double> heading;
  for (std::size_t i = 0; i < n && !heading; ++i) heading = known[i];
  if (!heading) heading = track.hits.front().box.yaw_rad;
  std::vector<double> yaws(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (known[i]) {
      heading = known[i];
    } else if (span.hits[i]) {
      const double off_rad =
          std::remainder(track.hits[*span.hits[i]].box.yaw_rad - *heading, std::numbers::pi);
      // Length and width mixed up say nothing; small steps follow a turn.
      if (std::abs(off_rad) < 0.25 * std::numbers::pi) *heading += 0.3 * off_rad;
    }
    yaws[i] = *heading;
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

/// A place that it moved on from is a new view each time, but boxes of scans in a row have the same
/// faults.
constexpr double kScanWeight = 0.15;

void add_evidence(const Track& track, const Span& span, std::size_t i, const Look& look,
                  Evidence& evidence) {
  if (span.hits[i]) {
    ++evidence.hits;
    evidence.log_odds += kScanWeight * log_odds_of(track.hits[*span.hits[i]].box.score);
    return;
  }
  const bool between =
      span.scans[i] > track.hits.front().scan && span.scans[i] < track.hits.back().scan;
  if (!between) return;
  if (look.sight == Sight::kFree) {
    evidence.log_odds += kFreeLogOdds;
  } else if (look.points >= kMinPointsToMiss) {
    ++evidence.missed;
    evidence.log_odds += kScanWeight * kMissLogOdds;
  }
}

}  // namespace

MovingObject moving_object(const Track& track, const std::vector<DetectedScan>& scans,
                           const std::vector<std::size_t>& drive_scans, const SightLines& sight) {
  MovingObject object;
  object.box.object_class = class_of(track.hits);
  object.box.size_m = size_of(track.hits);
  const Span span = span_of(track, drive_scans);
  const std::vector<MotionState> path = path_of(track, span, scans, object.box);
  const std::vector<double> yaws = yaws_of(track, span, path);
  const std::vector<double> heights = heights_of(track, span);
  for (std::size_t i = 0; i < span.scans.size(); ++i) {
    ObjectPlacement placement;
    placement.scan = span.scans[i];
    placement.detected = span.hits[i].has_value();
    if (track.given && placement.detected) {
      placement.box = track.hits[*span.hits[i]].box;
    } else {
      placement.box = object.box;
      placement.box.centre << path[i].position, heights[i];
      placement.box.yaw_rad = yaws[i];
    }
    const Look look = sight.look(placement.scan, placement.box);
    add_evidence(track, span, i, look, object.evidence);
    if (placement.detected || look.sight != Sight::kFree) object.placements.push_back(placement);
  }
  return object;
}

}  // namespace stillmap::mapping

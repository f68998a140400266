#include "fusion/standing.hpp"

#include "fusion/box_estimate.hpp"
#include "fusion/box_frames.hpp"

#include <algorithm>
#include <map>

namespace stillmap::mapping {
namespace {

/// Farther away a scan has few points on an object [m].
constexpr double kReachM = 80.0;
/// Misses beyond this range are not counted: detectors see as far as they like [m].
constexpr double kMissReachM = 30.0;
/// Other drives are asked from as near as this [m], an evenly spread dozen of scans each.
constexpr double kOtherDayReachM = 25.0;
constexpr std::size_t kOtherDayScans = 12;
/// Scans in a row that must see a place free before it is so: single ones see through gaps.
constexpr std::size_t kFreeInARow = 2;
/// Boxes that share less of their joint area with the whole say nothing for it, those that share
/// more say all they can.
constexpr double kNoAgreement = 0.35;
constexpr double kFullAgreement = 0.7;

/// What the boxes of each scan say, by their scores and by how far they agree with the whole.
std::map<std::size_t, double> opinions_of(const Track& track, const maps::Box& box) {
  std::map<std::size_t, double> opinions;
  for (const Hit& hit : track.hits) {
    const double agreement = std::clamp(
        (overlap_of(hit.box, box).of_joint - kNoAgreement) / (kFullAgreement - kNoAgreement), 0.0,
        1.0);
    const double log_odds = agreement * log_odds_of(hit.box.score);
    const auto [at, is_new] = opinions.try_emplace(hit.scan, log_odds);
    if (!is_new) at->second = std::max(at->second, log_odds);
  }
  return opinions;
}

}  // namespace

StandingCase::StandingCase(Track track, const PlaceLooks& looks)
    : track_(std::move(track)), box_{standing_box(track_.hits)} {
  find_views(looks);
  find_other_days(looks);
}

void StandingCase::find_views(const PlaceLooks& looks) {
  const Eigen::Vector2d place = box_[0].centre.head<2>();
  const std::map<std::size_t, double> opinions = opinions_of(track_, box_[0]);
  std::vector<std::size_t> scans = looks.scans_near(track_.drive, place, kReachM);
  // Detectors may see farther than that.
  for (const auto& [scan, opinion] : opinions) scans.push_back(scan);
  std::sort(scans.begin(), scans.end());
  scans.erase(std::unique(scans.begin(), scans.end()), scans.end());
  for (std::size_t i = 0; i < scans.size(); ++i) {
    View view{.scan = scans[i]};
    view.weight = view_weight(i == 0 ? 0.0 : looks.travel_m(scans[i - 1], scans[i]));
    view.near = looks.distance_m(scans[i], place) < kMissReachM;
    if (const auto opinion = opinions.find(scans[i]); opinion != opinions.end()) {
      view.hit = true;
      view.opinion = opinion->second;
    }
    views_.push_back(view);
  }
}

void StandingCase::find_other_days(const PlaceLooks& looks) {
  for (std::size_t drive = 0; drive < looks.drives(); ++drive) {
    if (drive == track_.drive) continue;
    const std::vector<std::size_t> near =
        looks.scans_near(drive, box_[0].centre.head<2>(), kOtherDayReachM);
    const std::size_t asked = std::min(near.size(), kOtherDayScans);
    std::vector<std::size_t> scans;
    for (std::size_t i = 0; i < asked; ++i) scans.push_back(near[i * near.size() / asked]);
    if (!scans.empty()) other_days_.push_back(std::move(scans));
  }
}

std::vector<PlaceQuestion> StandingCase::questions() const {
  std::vector<PlaceQuestion> questions;
  for (const View& view : views_) questions.push_back({view.scan, &box_[0]});
  for (const auto& scans : other_days_) {
    for (const std::size_t scan : scans) questions.push_back({scan, &box_[0]});
  }
  return questions;
}

/// Times when the object was not there, by view: runs of views that saw the place free, and all
/// that is before such a run ahead of the first hit or after one behind the last hit.
std::vector<bool> StandingCase::times_gone(std::span<const PlaceLook> answers) const {
  const std::size_t n = views_.size();
  const auto is_hit = [](const View& view) { return view.hit; };
  const auto first =
      static_cast<std::size_t>(std::find_if(views_.begin(), views_.end(), is_hit) - views_.begin());
  const std::size_t last =
      n - 1 -
      static_cast<std::size_t>(std::find_if(views_.rbegin(), views_.rend(), is_hit) -
                               views_.rbegin());
  std::vector<bool> gone(n, false);
  std::size_t begin = 0, end = 0, length = 0;
  const auto close_run = [&] {
    if (length >= kFreeInARow) {
      const std::size_t from = end < first ? 0 : begin;
      const std::size_t to = begin > last ? n - 1 : end;
      std::fill(gone.begin() + static_cast<std::ptrdiff_t>(from),
                gone.begin() + static_cast<std::ptrdiff_t>(to) + 1, true);
    }
    length = 0;
  };
  for (std::size_t i = 0; i < n; ++i) {
    if (views_[i].hit || answers[i].state == PlaceState::kOccupied) {
      close_run();
    } else if (answers[i].state == PlaceState::kFree) {
      if (length++ == 0) begin = i;
      end = i;
    }
  }
  close_run();
  return gone;
}

bool StandingCase::free_on_another_day(std::span<const PlaceLook> answers) const {
  std::size_t next = views_.size();
  bool free_once = false;
  for (const auto& scans : other_days_) {
    std::size_t free = 0, occupied = 0;
    for (std::size_t i = 0; i < scans.size(); ++i, ++next) {
      free += answers[next].state == PlaceState::kFree ? 1 : 0;
      occupied += answers[next].state == PlaceState::kOccupied ? 1 : 0;
    }
    free_once = free_once || (free >= kFreeInARow && occupied == 0);
  }
  return free_once;
}

StandingObject StandingCase::concluded(std::span<const PlaceLook> answers) const {
  StandingObject object{box_[0], {}, {}};
  const std::size_t first = track_.hits.front().scan, last = track_.hits.back().scan;
  const std::vector<bool> gone = times_gone(answers);
  for (std::size_t i = 0; i < views_.size(); ++i) {
    const View& view = views_[i];
    const bool between = view.scan > first && view.scan < last;
    if (view.hit) {
      object.evidence.add_hit(view.weight, view.opinion);
    } else if (answers[i].state == PlaceState::kFree ? between : view.near && !gone[i]) {
      object.evidence.add_silence(view.weight, answers[i]);
    }
    if (gone[i] && !between) object.evidence.free_elsewhen = true;
    if (!gone[i] && (view.hit || answers[i].has_points))
      object.scans.emplace_back(view.scan, view.hit);
  }
  if (free_on_another_day(answers)) object.evidence.free_elsewhen = true;
  return object;
}

}  // namespace stillmap::mapping

#include "history.hpp"

#include <stillmap/maps/trajectory.hpp>

#include <iterator>

namespace stillmap::localization {
namespace {

/// Stamps may come closer together than scans do; memory stays bounded all the same.
constexpr std::size_t kMaxKept = 1024;

}  // namespace

bool TrackingHistory::keeps(std::int64_t stamp_ns) const {
  return newest_ns_ && maps::seconds_between(stamp_ns, *newest_ns_) <= kept_s_;
}

const TrackedPose* TrackingHistory::answer_at(std::int64_t stamp_ns) const {
  const auto found = answers_.find(stamp_ns);
  return found == answers_.end() ? nullptr : &found->second;
}

const TrackingHistory::Known* TrackingHistory::state_at(std::int64_t stamp_ns) const {
  const auto found = states_.find(stamp_ns);
  return found == states_.end() ? nullptr : &found->second;
}

std::optional<TrackingHistory::Neighbours> TrackingHistory::around(std::int64_t stamp_ns) const {
  const auto after = states_.upper_bound(stamp_ns);
  if (after == states_.begin()) return std::nullopt;
  return Neighbours{&std::prev(after)->second, after == states_.end() ? nullptr : &after->second};
}

void TrackingHistory::add(const TrackedPose& answer) {
  answers_.emplace(answer.stamp_ns, answer);
  if (!newest_ns_ || *newest_ns_ < answer.stamp_ns) newest_ns_ = answer.stamp_ns;
  prune();
}

void TrackingHistory::add(const Known& known) {
  states_.insert_or_assign(known.state.stamp_ns, known);
}

void TrackingHistory::restore(std::int64_t newest_ns, const std::optional<Known>& newest) {
  newest_ns_ = newest_ns;
  if (newest) add(*newest);
}

void TrackingHistory::continue_from(const TrackingHistory& other,
                                    const std::function<void(PosePdf&)>& move) {
  newest_ns_ = other.newest_ns_;
  states_ = other.states_;
  for (auto& [stamp_ns, known] : states_) move(known.state.pose);
}

void TrackingHistory::prune() {
  const auto drop = [this](auto& kept) {
    while (!kept.empty() && (kept.size() > kMaxKept || !keeps(kept.begin()->first))) {
      kept.erase(kept.begin());
    }
  };
  drop(answers_);
  drop(states_);
}

}  // namespace stillmap::localization

#include "pose/rollout_counts.hpp"

namespace stillmap::server {

RolloutCounts::Group RolloutCounts::answered(const std::string& map, const std::string& version,
                                             std::string_view status,
                                             const std::optional<Rollout>& rollout) {
  const std::scoped_lock lock(mutex_);
  OfMap& counts = maps_[map];
  const bool runs = rollout && !rollout->halted;
  if (runs) begin(counts, *rollout);
  counts.by_version[version].add(status);
  if (runs && version == rollout->version) {
    counts.figures.rollout.add(status);
    return Group::kRollout;
  }
  // A session may still follow a version that was active before.
  if (!runs || version != rollout->active) return Group::kNone;
  counts.figures.others.add(status);
  return Group::kOthers;
}

void RolloutCounts::begin(OfMap& counts, const Rollout& rollout) {
  if (counts.begun_ns == rollout.begun_ns) return;
  counts.begun_ns = rollout.begun_ns;
  counts.figures = {.rollout = {}, .others = {}, .before = counts.by_version[rollout.active]};
}

RolloutFigures RolloutCounts::figures(const Rollout& rollout) const {
  const std::scoped_lock lock(mutex_);
  const auto found = maps_.find(rollout.map);
  if (found == maps_.end()) return {};
  if (found->second.begun_ns == rollout.begun_ns) return found->second.figures;
  const auto before = found->second.by_version.find(rollout.active);
  return {.rollout = {},
          .others = {},
          .before = before == found->second.by_version.end() ? AnswerCounts{} : before->second};
}

void RolloutCounts::forget(const std::string& map) {
  const std::scoped_lock lock(mutex_);
  maps_.erase(map);
}

}  // namespace stillmap::server

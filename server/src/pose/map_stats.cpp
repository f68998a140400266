#include "pose/map_stats.hpp"

#include <algorithm>
#include <cmath>
#include <span>

namespace stillmap::server {
namespace {

/// The smallest value that at least this share of all is not above (nearest rank).
double percentile(std::vector<float>& values, double share) {
  const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(std::max<std::size_t>(rank, 1) - 1);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

std::optional<MapStats::Percentiles> percentiles(std::span<const float> times_ms) {
  if (times_ms.empty()) return std::nullopt;
  std::vector<float> values(times_ms.begin(), times_ms.end());
  return MapStats::Percentiles{.p50_ms = percentile(values, 0.5),
                               .p95_ms = percentile(values, 0.95)};
}

}  // namespace

void MapStats::answered(const std::string& map, std::string_view status, double localizer_ms,
                        double total_ms, Clock::time_point now) {
  const std::scoped_lock lock(mutex_);
  Entry& entry = entries_[map];
  std::uint64_t& count = status == "ok"         ? entry.figures.ok
                         : status == "degraded" ? entry.figures.degraded
                                                : entry.figures.lost;
  ++count;
  entry.figures.last = now;
  entry.localizer_ms[entry.count % kTimed] = static_cast<float>(localizer_ms);
  entry.total_ms[entry.count % kTimed] = static_cast<float>(total_ms);
  ++entry.count;
}

void MapStats::refused(const std::string& map) {
  const std::scoped_lock lock(mutex_);
  ++entries_[map].figures.refused;
}

void MapStats::forget(const std::string& map) {
  const std::scoped_lock lock(mutex_);
  entries_.erase(map);
}

MapStats::Figures MapStats::figures(const std::string& map) const {
  const std::scoped_lock lock(mutex_);
  const auto found = entries_.find(map);
  if (found == entries_.end()) return {};
  const Entry& entry = found->second;
  Figures figures = entry.figures;
  figures.timed = static_cast<std::size_t>(std::min<std::uint64_t>(entry.count, kTimed));
  figures.localizer = percentiles(std::span(entry.localizer_ms).first(figures.timed));
  figures.total = percentiles(std::span(entry.total_ms).first(figures.timed));
  return figures;
}

}  // namespace stillmap::server

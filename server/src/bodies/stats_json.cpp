#include "bodies/stats_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {
namespace {

Json times(const std::optional<MapStats::Percentiles>& percentiles) {
  if (!percentiles) return {};
  return {{"p50", percentiles->p50_ms}, {"p95", percentiles->p95_ms}};
}

Json moment_of(const std::optional<MapStats::Clock::time_point>& time) {
  if (!time) return {};
  const auto since_epoch =
      std::chrono::duration_cast<std::chrono::nanoseconds>(time->time_since_epoch());
  return std::to_string(since_epoch.count());
}

}  // namespace

std::string map_stats_json(const std::string& map, const MapStats::Figures& figures,
                           std::size_t sessions) {
  return to_text(Json{
      {"map", map},
      {"queries", {{"ok", figures.ok}, {"degraded", figures.degraded}, {"lost", figures.lost}}},
      {"refused", figures.refused},
      {"last_query_ns", moment_of(figures.last)},
      {"latency_ms",
       {{"queries", figures.timed},
        {"localizer", times(figures.localizer)},
        {"total", times(figures.total)}}},
      {"sessions", sessions}});
}

}  // namespace stillmap::server

#pragma once

#include "pose/map_stats.hpp"

#include <cstddef>
#include <string>

namespace stillmap::server {

/// What `GET /v1/maps/{map}/stats` answers.
[[nodiscard]] std::string map_stats_json(const std::string& map, const MapStats::Figures& figures,
                                         std::size_t sessions);

}  // namespace stillmap::server

#pragma once

#include "operation/inspection.hpp"

#include <string>

namespace stillmap::server {

[[nodiscard]] std::string inspection_json(const MapSummary& summary);
[[nodiscard]] std::string inspection_json(const DriveSummary& summary);
[[nodiscard]] std::string inspection_json(const CloudFileSummary& summary);
[[nodiscard]] std::string inspection_json(const TrajectorySummary& summary);

}  // namespace stillmap::server

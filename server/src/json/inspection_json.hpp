#pragma once

#include "operation/inspection.hpp"

#include <string>

namespace stillmap::server {

[[nodiscard]] std::string inspection_json(const MapSummary& summary);
[[nodiscard]] std::string inspection_json(const DriveSummary& summary);

}  // namespace stillmap::server

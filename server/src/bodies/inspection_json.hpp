#pragma once

#include "operation/inspection.hpp"

#include <stillmap/maps/recording_choice.hpp>

#include <string>

namespace stillmap::server {

[[nodiscard]] std::string inspection_json(const MapSummary& summary);
[[nodiscard]] std::string inspection_json(const DriveSummary& summary);
[[nodiscard]] std::string inspection_json(const CloudFileSummary& summary);
[[nodiscard]] std::string inspection_json(const TrajectorySummary& summary);

/// Of a recording that cannot be opened before something is chosen.
[[nodiscard]] std::string inspection_json(const maps::ChoiceError& error);

/// The part of it that stands beside a drive in lists.
[[nodiscard]] std::string listed_inspection_json(const DriveSummary& summary);
[[nodiscard]] std::string listed_inspection_json(const maps::ChoiceError& error);

}  // namespace stillmap::server

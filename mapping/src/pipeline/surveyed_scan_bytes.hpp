#pragma once

#include "pipeline/scan_work.hpp"

#include <string>
#include <string_view>

namespace stillmap::mapping {

/// All of it, bit by bit, for a journal of the same program: some 0.8 MB for 120,000 points.
/// @param scan  with a view.
[[nodiscard]] std::string to_bytes(const SurveyedScan& scan);

/// @return the scan that gave the bytes.
/// @throws std::invalid_argument saying what is wrong with the bytes.
[[nodiscard]] SurveyedScan surveyed_scan_from(std::string_view bytes);

}  // namespace stillmap::mapping

#pragma once

#include "evaluation/localization/integrity.hpp"

#include <stillmap/mapping/localization_evaluation.hpp>

#include <string>
#include <vector>

namespace stillmap::mapping {

/// "1 m, 5 deg", "scan before" or "no prior".
[[nodiscard]] std::string name_of(const LocalizationLevel& level, PriorSource source);

/// Class of the style sheet for the curve of one level.
[[nodiscard]] std::string style_of_level(std::size_t level);

/// Each is one drawing as inline SVG. Curves are of the evaluation's levels, in their colours.

/// A bar a level, with its 95 % interval.
[[nodiscard]] std::string success_figure(const LocalizationEvaluation& evaluation);
/// Share of all queries that are off by less; a lost one is never.
[[nodiscard]] std::string translation_figure(const LocalizationEvaluation& evaluation);
[[nodiscard]] std::string yaw_figure(const LocalizationEvaluation& evaluation);
/// Share of all queries that took less CPU time.
[[nodiscard]] std::string latency_figure(const LocalizationEvaluation& evaluation);
/// Level against true error of the `ok` answers, with the regions that the alert limit makes.
/// @param axis  one with an alert limit.
[[nodiscard]] std::string stanford_figure(const std::vector<LocalizationQuery>& queries, Axis axis);
/// Histogram of NEES beside the density of chi-squared with 6 degrees of freedom.
[[nodiscard]] std::string nees_figure(const std::vector<LocalizationQuery>& queries);

}  // namespace stillmap::mapping

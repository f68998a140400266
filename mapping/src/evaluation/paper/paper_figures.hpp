#pragma once

#include <stillmap/mapping/paper_evaluation.hpp>

namespace stillmap::mapping {

/// Root mean square over the scans of one street; NaN without scans.
[[nodiscard]] double street_rmse_xy_m(const PaperAnswers& street);
[[nodiscard]] double street_rmse_yaw_rad(const PaperAnswers& street);

/// Fills the figures of every row from its answers, and `differences` from the rows.
/// @throws std::invalid_argument when rows were not asked with the same scans, or with none.
void judge(PaperEvaluation& evaluation);

}  // namespace stillmap::mapping

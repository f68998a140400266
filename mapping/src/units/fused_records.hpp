#pragma once

#include "pipeline/build.hpp"
#include "pipeline/build_journal.hpp"
#include "units/survey_records.hpp"

#include <Eigen/Geometry>

#include <cstddef>
#include <optional>
#include <string>

/// What the unit `fuse` leaves to those after it: objects, corrections, sums of the survey, and the
/// finished ground.
namespace stillmap::mapping {

/// @param records  of the survey that it is made from. @param units  of the build.
[[nodiscard]] std::string fused_key(const Build& build, const SurveyRecords& records,
                                    std::size_t units);

/// Writes it from `build.survey` and `build.objects`, and completes the journal.
void write_fused(const Build& build, BuildJournal& journal);

/// Sets `build.survey` and `build.objects`; the survey has no boxes, flags and views.
/// @param ground  local frame [m]: where the ground is wanted; none of it without.
/// @throws maps::InputError when the journal is not complete or broken.
void read_fused(Build& build, const BuildJournal& journal,
                const std::optional<Eigen::AlignedBox2d>& ground);

}  // namespace stillmap::mapping

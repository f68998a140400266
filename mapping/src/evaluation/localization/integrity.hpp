#pragma once

#include <stillmap/mapping/localization_evaluation.hpp>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// The axes that protection levels are given for. Those with an alert limit come first.
enum class Axis { kLongitudinal, kLateral, kYaw, kVertical };

/// |error| along an axis [m or rad]; NaN when lost.
[[nodiscard]] double error_along(const LocalizationQuery& query, Axis axis);
/// Protection level of an axis [m or rad].
[[nodiscard]] double level_along(const LocalizationQuery& query, Axis axis);
/// [m or rad]; infinite for `kVertical`, where a street sets none.
[[nodiscard]] double alert_limit_of(Axis axis);

/// `ok`, and an error is beyond its level.
[[nodiscard]] bool is_misleading(const LocalizationQuery& query);
/// `ok`, and an error is beyond its alert limit while the level is inside.
[[nodiscard]] bool is_hazardous(const LocalizationQuery& query);
/// `ok`, and every level is inside its alert limit.
[[nodiscard]] bool is_available(const LocalizationQuery& query);

/// @param seed  of the resampling.
[[nodiscard]] Integrity integrity_of(const std::vector<LocalizationQuery>& queries,
                                     std::uint64_t seed);

}  // namespace stillmap::mapping

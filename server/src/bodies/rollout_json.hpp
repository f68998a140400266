#pragma once

#include "pose/halt_rule.hpp"
#include "pose/vehicle_table.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Longest body of a roll-out [bytes].
inline constexpr std::uint64_t kMostRolloutJson = std::uint64_t{16} << 10U;

/// `{version, share?, vehicles?, halt? {least_answers?, most_rise?}}`.
/// @return without a map and a time. @throws ApiError kInvalidRequest, kUnknownParameter.
[[nodiscard]] Rollout read_rollout_json(std::string_view text);
/// @param state  of the version, as `name_of(MapState)`.
[[nodiscard]] std::string rollout_json(const Rollout& rollout, const RolloutFigures& figures,
                                       std::string_view state);
/// Of a map that has none.
[[nodiscard]] std::string no_rollout_json(const std::string& map);
/// @param next  where the list goes on; nothing at its end.
[[nodiscard]] std::string vehicle_list_json(const std::vector<VehicleTable::Vehicle>& vehicles,
                                            const std::optional<std::string>& next);

}  // namespace stillmap::server

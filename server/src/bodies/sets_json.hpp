#pragma once

#include "store/set_table.hpp"

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Longest body of a set [bytes], and most maps in it.
inline constexpr std::size_t kMostSetJson = std::size_t{256} << 10U;
inline constexpr std::size_t kMostMapsOfSet = 1000;

/// Reads `maps [{map, position?, quaternion?}]`; a map without a pose lies in the set's frame.
/// @throws ApiError with the path of what is wrong.
[[nodiscard]] MapSet read_set_json(std::string_view text);
[[nodiscard]] std::string set_json(const MapSet& set);
/// `{"sets": [...]}`.
[[nodiscard]] std::string sets_json(const std::vector<MapSet>& sets);

}  // namespace stillmap::server

#pragma once

#include <stillmap/mapping/map_build.hpp>

#include <string>

namespace stillmap::mapping {

/// Reads what `to_json` wrote of a build. The notes are not in it.
/// @throws std::invalid_argument.
[[nodiscard]] MapBuildResult build_result_from(const std::string& json);

}  // namespace stillmap::mapping

#pragma once

#include <filesystem>
#include <string>

namespace stillmap::mapper {

/// Writes the index beside the tiles, so that the first query need not. A map that is too sparse to
/// be searched is still a map.
/// @return where it is, or why there is none.
[[nodiscard]] std::string write_index(const std::filesystem::path& map);

}  // namespace stillmap::mapper

#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Files of a detector `boxes:FILE[,FILE...]`; empty for any other.
[[nodiscard]] std::vector<std::filesystem::path> boxes_files(const std::string& detector);

}  // namespace stillmap::mapping

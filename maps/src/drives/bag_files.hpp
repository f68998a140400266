#pragma once

#include <filesystem>
#include <vector>

namespace stillmap::maps {

[[nodiscard]] bool holds_bag_files(const std::filesystem::path& folder);

/// The files of one bag in their order: itself, or those of its folder by `metadata.yaml`, else by
/// name.
/// @throws InputError when a file that `metadata.yaml` names is missing, or there are two kinds.
[[nodiscard]] std::vector<std::filesystem::path> bag_files(const std::filesystem::path& root);

}  // namespace stillmap::maps

#pragma once

#include <stillmap/localization/options.hpp>

#include <filesystem>
#include <string>

namespace stillmap::server {

/// Reads options of localization: a JSON object with `preset` and the groups `aligner`, `verdict`
/// and `tracker`. What the file does not name keeps the preset's value.
/// @throws maps::InputError naming the file, the key, what was found and what is expected;
/// maps::StorageError when it cannot be read.
[[nodiscard]] localization::LocalizationOptions read_localization_options(
    const std::filesystem::path& file);

/// `FOLDER/MAP.json`, read as above; the defaults where there is no such file, or no folder is set.
[[nodiscard]] localization::LocalizationOptions localization_options_of(
    const std::filesystem::path& folder, const std::string& map);

/// All options with their values, as a file that can be read back.
[[nodiscard]] std::string localization_options_json(
    const localization::LocalizationOptions& options);

}  // namespace stillmap::server

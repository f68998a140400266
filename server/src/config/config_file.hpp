#pragma once

#include "config_problem.hpp"
#include "option_table.hpp"

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::server {

/// What a configuration file says: its known keys, in the file's order, and all that is wrong with
/// it.
struct ConfigText {
  std::vector<std::pair<const Option*, OptionValue>> values;
  std::vector<ConfigProblem> problems;
};

/// More than ten times what all options with a comment each take.
inline constexpr std::size_t kMostConfigBytes = std::size_t{256} << 10U;

/// Reads JSON with comments: an object of options and of groups of options. Values are of the right
/// kind and within their own bounds. Safe with any bytes.
/// @param name  how problems call the file.
[[nodiscard]] ConfigText parse_config(std::string_view text, const std::string& name);

/// The same of a file; one that cannot be read is a problem too.
[[nodiscard]] ConfigText read_config(const std::filesystem::path& file);

/// The known key that was probably meant; empty when none is near.
[[nodiscard]] std::string_view nearest_key(std::string_view key);

}  // namespace stillmap::server

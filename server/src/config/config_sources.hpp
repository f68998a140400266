#pragma once

#include "config_problem.hpp"

#include <stillmap/server/server_options.hpp>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Where options come from, beside their defaults. A flag wins over the environment, that over the
/// file, that over the default.
struct ConfigSources {
  std::optional<std::filesystem::path> file;
  /// Variables that begin with `kVariablePrefix`.
  std::vector<std::pair<std::string, std::string>> environment;
  /// The command line's text, by the option's key.
  std::map<std::string, std::string> flags;
};

/// The variable that names the configuration file, when no flag does.
inline constexpr std::string_view kConfigVariable = "STILLMAP_SERVE_CONFIG";

/// Those of this process. `kConfigVariable` is left out of them: it is no option.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> own_environment();

struct ResolvedConfig {
  /// Usable when there are no problems.
  ServerOptions options;
  /// For each key that is not at its default, who says so: the file, a variable or a flag.
  std::map<std::string, std::string> origins;
  std::vector<ConfigProblem> problems;
};

/// Reads the file and puts all together; every problem of every source is in the result.
[[nodiscard]] ResolvedConfig resolve(const ConfigSources& sources);

}  // namespace stillmap::server

#pragma once

#include "config/config_sources.hpp"

#include <vector>

namespace stillmap::server {

/// Looks at the files and folders that the options name: the store, the TLS certificate with its
/// key, the log file. Nothing is made, locked or changed, so that it may run beside a server.
/// @param config  without problems.
/// @return what a start would fail on; nothing of what is not named.
[[nodiscard]] std::vector<ConfigProblem> problems_of_files(const ResolvedConfig& config);

}  // namespace stillmap::server

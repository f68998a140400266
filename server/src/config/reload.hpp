#pragma once

#include "config_sources.hpp"

#include <stillmap/server/options_holder.hpp>

#include <string>
#include <vector>

namespace stillmap::server {

struct ReloadReport {
  /// Keys whose new value is in force.
  std::vector<std::string> changed;
  /// Keys that differ now and keep the value they had until a restart.
  std::vector<std::string> need_restart;
  /// When there are any, all is as it was.
  std::vector<ConfigProblem> problems;
};

/// Reads `sources` again and puts in force what may change in a running server.
[[nodiscard]] ReloadReport reload(const ConfigSources& sources, OptionsHolder& holder);

}  // namespace stillmap::server

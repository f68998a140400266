#pragma once

#include "config_sources.hpp"

#include <stillmap/server/options_holder.hpp>

#include <functional>
#include <string>
#include <vector>

namespace stillmap::server {

struct ReloadResult {
  /// Keys whose new value is in force.
  std::vector<std::string> changed;
  /// Keys that differ now and keep the value they had until a restart.
  std::vector<std::string> need_restart;
  /// When there are any, all is as it was.
  std::vector<ConfigProblem> problems;
};

/// Puts in force what was prepared. Cannot fail.
using PreparedReload = std::function<void()>;
/// Tries all that can fail for the options to come, and changes nothing yet. Throws what is wrong.
using ReloadPreparation = std::function<PreparedReload(const ServerOptions& next)>;

/// Reads `sources` again and puts in force what may change in a running server: all of it, or
/// nothing.
/// @param others  what goes with the options, asked in this order once these can be used.
/// @throws what one of `others` throws, with all as it was.
[[nodiscard]] ReloadResult reload(const ConfigSources& sources, OptionsHolder& holder,
                                  const std::vector<ReloadPreparation>& others = {});

}  // namespace stillmap::server

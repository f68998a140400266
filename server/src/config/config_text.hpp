#pragma once

#include "config_sources.hpp"

#include <string>

namespace stillmap::server {

/// What a configuration file may hold, as JSON Schema (draft 2020-12). `server/config.schema.json`
/// is this text.
[[nodiscard]] std::string config_schema();

/// Every option with its flag, default and bounds, as a page. `server/configuration.md` is this
/// text.
[[nodiscard]] std::string config_page();

/// The values in force, as a configuration file with the origin of each in a comment.
[[nodiscard]] std::string config_listing(const ResolvedConfig& config);

}  // namespace stillmap::server

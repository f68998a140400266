#pragma once

#include <stillmap/maps/map_export.hpp>

#include <string>

namespace stillmap::server {

/// What `stillmap export` prints with --json.
[[nodiscard]] std::string export_json(const std::string& format,
                                      const maps::MapExportReport& report);

}  // namespace stillmap::server

#pragma once

#include <fmt/format.h>
#include <stillmap/mapping/map_consistency.hpp>

#include <string>

#include "command_line/table.hpp"

namespace stillmap::command_line {

/// Adds how well a map's scans agree with each other.
inline void add_consistency(Table& table, const mapping::MapConsistency& consistency) {
  const auto thickness = [](const mapping::SurfaceThickness& surface) {
    if (surface.cells == 0) return std::string("none to measure");
    return fmt::format("{} cm, 95 % below {} cm; {} of {} cells are planar",
                       number_text(100.0 * surface.median_m, 2),
                       number_text(100.0 * surface.p95_m, 2),
                       percent_text(surface.planar_share(), 1), grouped(surface.cells));
  };
  table.add("mean map entropy",
            fmt::format("{} nat, of {} points", number_text(consistency.mean_map_entropy, 3),
                        grouped(consistency.entropy_points)));
  table.add("thickness of walls, median", thickness(consistency.walls));
  table.add("thickness of ground, median", thickness(consistency.ground));
}

}  // namespace stillmap::command_line

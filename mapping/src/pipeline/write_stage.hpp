#pragma once

namespace stillmap::mapping {

struct Build;

/// Stage: writes objects, trajectories and sources, and gives the package its manifest and place.
void write_package(Build& build);

}  // namespace stillmap::mapping

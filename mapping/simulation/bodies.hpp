#pragma once

#include <stillmap/maps/box.hpp>

#include <cstdint>
#include <string_view>
#include <vector>

#include "mesh.hpp"

namespace stillmap::simulation {

/// Body of something that can move: x forward, z up, standing on z = 0 about the origin.
struct Body {
  maps::ObjectClass object_class = maps::ObjectClass::kUnknown;
  Mesh mesh;
};

/// Every vehicle of the world: small car, saloon, estate, SUV, van.
[[nodiscard]] std::vector<Body> make_vehicles();

/// A person as a capsule, 1.6 to 1.9 m tall.
[[nodiscard]] std::vector<Body> make_persons();

}  // namespace stillmap::simulation

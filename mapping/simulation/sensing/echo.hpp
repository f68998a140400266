#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "geometry/random.hpp"
#include "sensing/ray_scene.hpp"
#include "sensing/sensor.hpp"

/// What becomes of a ray: through glass and wire, off a surface, back to the sensor or not.
namespace stillmap::simulation {

/// What the sensor gets back from one ray.
struct Echo {
  double range_m = 0.0;
  /// In [0, 1], before it is rounded.
  double intensity = 0.0;
  /// Light that came back, against a white sheet met head on at 1 m.
  double power = 0.0;
  std::uint32_t label = 0;
};

struct RayOutcome {
  std::optional<Echo> echo;
  /// The ray met an object on its way, whether an echo came from it or not.
  bool met_object = false;
};

/// Follows a ray from its first hits to the surface that sends it back.
/// @param objects  false: as if there were none.
[[nodiscard]] RayOutcome follow_ray(const World& world, const RayScene& scene,
                                    const SensorProperties& sensor, const Ray& ray,
                                    const Hits& first, bool objects, Random random);

/// Light of a beam that falls on an edge comes from both surfaces: the range lies between them
/// where the sensor cannot tell them apart, or is that of the stronger one.
/// @param echoes  of beams that follow each other; neighbours count where they are of one ring.
void mix_edges(std::vector<std::optional<Echo>>& echoes, const std::vector<Beam>& beams,
               const SensorProperties& sensor, std::uint64_t key);

}  // namespace stillmap::simulation

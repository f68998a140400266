#pragma once

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

/// Things that stand along a road and stay. Each has its foot at the origin, x along the road, y
/// away from the carriageway, z up; posts reach 0.3 m into the ground. So x runs against the
/// direction of the nearest lane (traffic keeps to the right).
namespace stillmap::simulation {

/// Lamp whose arm reaches over the carriageway (towards -y).
[[nodiscard]] Mesh make_lamp(Random& random);
/// One to three plates on a post. Faces the traffic that drives along +x, so who places it turns it
/// half round.
[[nodiscard]] Mesh make_traffic_sign(Random& random);
/// Turned half round like a sign; its arm, if any, reaches to +y, which then is over the
/// carriageway.
[[nodiscard]] Mesh make_traffic_light(Random& random);
[[nodiscard]] Mesh make_bollard(Random& random);
[[nodiscard]] Mesh make_bin(Random& random);
[[nodiscard]] Mesh make_bench(Random& random);
[[nodiscard]] Mesh make_bus_shelter(Random& random);
/// Cabinet of an electricity or telephone company.
[[nodiscard]] Mesh make_cabinet(Random& random);
/// Pole that carries wires, without the wires.
[[nodiscard]] Mesh make_utility_pole(Random& random);
/// Gantry over a carriageway that is `width_m` wide, its near post at the origin, reaching to -y.
/// Its boards face the traffic under it, which drives along -x: it is not turned.
[[nodiscard]] Mesh make_gantry(double width_m, Random& random);
/// Shipping containers, one to three on top of each other, along x with their middle at the origin.
[[nodiscard]] Mesh make_container_stack(Random& random);

enum class BorderKind { kWall, kHedge, kPicketFence, kRailing, kMeshFence, kGuardRail, kNoiseWall };
/// Piece of a border from the origin to (length_m, 0, 0), `height_m` over the ground and 0.4 m into
/// it (so that pieces in a row follow a slope). Its front is at y = 0, its thickness towards +y.
[[nodiscard]] Mesh make_border_piece(BorderKind kind, double length_m, double height_m,
                                     Random& random);

/// Building site, some 12 x 3 m around the origin: barriers, mesh fences, heap of sand, pipes, a
/// container, signs.
[[nodiscard]] Mesh make_building_site(Random& random);

}  // namespace stillmap::simulation

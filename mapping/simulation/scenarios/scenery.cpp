#include <cmath>
#include <numbers>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"

namespace stillmap::simulation {

RoadsideFrame beside_road(const RoadEdge& edge, int side, double station_m, double out_m) {
  const double sign = side == 0 ? 1.0 : -1.0;
  // Right-hand traffic: on the left side of the line one drives against it.
  return {edge.point(station_m, sign * (edge.half_width(side) + out_m)),
          edge.heading_rad(station_m) + (side == 0 ? std::numbers::pi : 0.0)};
}

Eigen::Isometry3d T_world_roadside(const Terrain& terrain, const RoadEdge& edge, int side,
                                   double station_m, double out_m) {
  const RoadsideFrame beside = beside_road(edge, side, station_m, out_m);
  // Away from the carriageway is to the right of who drives on the nearest lane. A frame with z up
  // and y to that side has x against the lane's direction.
  return terrain.T_world_upright(beside.point, beside.heading_rad + std::numbers::pi);
}

std::vector<std::size_t> Scenery::variants(std::size_t count, std::uint64_t stream,
                                           const std::function<Mesh(Random&)>& make) {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < count; ++i) {
    Random random(key_of({seed_, static_cast<std::uint64_t>(Stream::kFurniture), stream, i}));
    indices.push_back(world_.shapes.size());
    world_.shapes.push_back(make(random));
  }
  return indices;
}

void Scenery::place(std::size_t shape, const Eigen::Isometry3d& T_world_shape, double scale) {
  if (!world_.terrain->covers(T_world_shape.translation().head<2>())) return;
  Eigen::Affine3d T(T_world_shape.matrix());
  T.scale(scale);
  world_.placements.push_back({shape, T});
}

}  // namespace stillmap::simulation

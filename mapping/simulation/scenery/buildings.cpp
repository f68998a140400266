#include "scenery/buildings.hpp"

#include "scenery/building_body.hpp"

namespace stillmap::simulation {

void add_building(Mesh& mesh, const Eigen::Isometry3d& T_world_front, const BuildingShape& shape,
                  Random& random) {
  const WallPlane front(mesh, T_world_front, Surface::kWall);
  switch (shape.kind) {
    case BuildingKind::kHouse:
      return add_house(front, shape, random);
    case BuildingKind::kFlats:
    case BuildingKind::kShop:
      return add_flats(front, shape, random);
    case BuildingKind::kHall:
      return add_hall(front, shape, random);
  }
}

}  // namespace stillmap::simulation

#include "buildings.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::simulation {
namespace {

constexpr double kFloorHeight = 3.1;
// Walls reach below the ground, which may fall along the house.
constexpr double kFoundation = -0.8;
constexpr double kWindowDepth = 0.18;
constexpr double kDoorDepth = 0.35;

/// Rectangle of the front: x along it, z up [m].
struct Rectangle {
  double left, right, low, high;
};

struct Opening {
  Rectangle edge;
  double depth;
  Surface surface;
};

/// Draws in the frame of a house.
class Front {
 public:
  Front(Mesh& mesh, const Eigen::Isometry3d& T_world_front) : mesh_(mesh), T_(T_world_front) {}

  void quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
            const Eigen::Vector3d& d, Surface surface) {
    mesh_.add_quad(T_ * a, T_ * b, T_ * c, T_ * d, surface);
  }
  void triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                Surface surface) {
    mesh_.add_triangle(T_ * a, T_ * b, T_ * c, surface);
  }
  void box(const Eigen::Vector3d& low, const Eigen::Vector3d& high, Surface surface) {
    mesh_.add_box(T_, low, high, surface);
  }
  void upright(const Rectangle& r, double y, Surface surface) {
    quad({r.left, y, r.low}, {r.right, y, r.low}, {r.right, y, r.high}, {r.left, y, r.high},
         surface);
  }
  /// One bay of wall with an opening in it: wall around, reveals, and what closes it.
  void bay(const Rectangle& wall, const Opening& opening) {
    const Rectangle& o = opening.edge;
    upright({wall.left, o.left, wall.low, wall.high}, 0.0, Surface::kWall);
    upright({o.right, wall.right, wall.low, wall.high}, 0.0, Surface::kWall);
    upright({o.left, o.right, wall.low, o.low}, 0.0, Surface::kWall);
    upright({o.left, o.right, o.high, wall.high}, 0.0, Surface::kWall);
    for (const double x : {o.left, o.right}) {
      quad({x, 0, o.low}, {x, opening.depth, o.low}, {x, opening.depth, o.high}, {x, 0, o.high},
           Surface::kWall);
    }
    for (const double z : {o.low, o.high}) {
      quad({o.left, 0, z}, {o.right, 0, z}, {o.right, opening.depth, z}, {o.left, opening.depth, z},
           Surface::kWall);
    }
    upright(o, opening.depth, opening.surface);
  }

 private:
  Mesh& mesh_;
  Eigen::Isometry3d T_;
};

void add_facade(Front& front, const BuildingShape& shape, Random& random) {
  const int bays = std::max(2, static_cast<int>(std::lround(shape.width / 3.0)));
  const double bay_width = shape.width / bays;
  const auto door_bay = static_cast<int>(random.index(static_cast<std::size_t>(bays)));
  const double window_width = random.uniform(0.9, 1.5);
  const double window_height = random.uniform(1.2, 1.7);
  for (int floor = 0; floor < shape.floors; ++floor) {
    const double foot = floor * kFloorHeight;
    for (int bay = 0; bay < bays; ++bay) {
      const double left = -0.5 * shape.width + bay * bay_width;
      const double middle = left + 0.5 * bay_width;
      const Rectangle wall{left, left + bay_width, floor == 0 ? kFoundation : foot,
                           foot + kFloorHeight};
      if (floor == 0 && bay == door_bay) {
        front.bay(
            wall,
            {{middle - 0.5, middle + 0.5, kFoundation + 0.01, 2.15}, kDoorDepth, Surface::kDoor});
      } else {
        front.bay(wall, {{middle - 0.5 * window_width, middle + 0.5 * window_width, foot + 0.95,
                          foot + 0.95 + window_height},
                         kWindowDepth,
                         Surface::kWindow});
      }
    }
    const bool has_balconies = floor > 0 && random.chance(0.25);
    if (has_balconies) {
      const double middle = -0.5 * shape.width + (door_bay + 0.5) * bay_width;
      const double half = 0.4 * bay_width;
      front.box({middle - half, -1.1, foot - 0.15}, {middle + half, 0.0, foot}, Surface::kWall);
      front.box({middle - half, -1.1, foot}, {middle + half, -1.05, foot + 0.95}, Surface::kWall);
    }
  }
}

void add_rest(Front& front, const BuildingShape& shape, Random& random) {
  const double half = 0.5 * shape.width;
  const double top = shape.floors * kFloorHeight;
  const double ridge = top + random.uniform(1.5, 3.0);
  const double middle = 0.5 * shape.depth;
  for (const double x : {-half, half}) {
    front.quad({x, 0, kFoundation}, {x, shape.depth, kFoundation}, {x, shape.depth, top},
               {x, 0, top}, Surface::kWall);
    front.triangle({x, 0, top}, {x, shape.depth, top}, {x, middle, ridge}, Surface::kWall);
  }
  front.upright({-half, half, kFoundation, top}, shape.depth, Surface::kWall);
  // The eaves stand out over the front.
  const double out = random.uniform(0.2, 0.5);
  front.quad({-half, -out, top - 0.1}, {half, -out, top - 0.1}, {half, middle, ridge},
             {-half, middle, ridge}, Surface::kRoof);
  front.quad({-half, shape.depth, top}, {half, shape.depth, top}, {half, middle, ridge},
             {-half, middle, ridge}, Surface::kRoof);
  front.box({-half, -0.06, kFoundation}, {half, -0.001, random.uniform(0.3, 0.7)}, Surface::kWall);
}

}  // namespace

void add_building(Mesh& mesh, const Eigen::Isometry3d& T_world_front, const BuildingShape& shape,
                  Random& random) {
  Front front(mesh, T_world_front);
  add_facade(front, shape, random);
  add_rest(front, shape, random);
}

}  // namespace stillmap::simulation

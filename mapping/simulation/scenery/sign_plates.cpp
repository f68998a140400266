#include "scenery/sign_plates.hpp"

#include <cmath>
#include <numbers>

#include "scenery/parts.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kThickness_m = 0.005;
// Side of a triangular plate and what its height is against it.
constexpr double kTriangle_m = 0.9;
constexpr double kTriangleHeight = 0.5 * std::numbers::sqrt3;

}  // namespace

void add_plate(Mesh& mesh, const Eigen::Vector3d& middle, const Eigen::Vector3d& u,
               const Eigen::Vector3d& v, int corners) {
  const Eigen::Vector3d behind = -kThickness_m * u.cross(v).normalized();
  add_polygon(mesh, middle, u, v, corners, Surface::kSign);
  add_polygon(mesh, middle + behind, u, v, corners, Surface::kSignBack);
}

void add_board(Mesh& mesh, const Eigen::Vector3d& middle, const Eigen::Vector3d& u,
               const Eigen::Vector3d& v) {
  add_plate(mesh, middle, u + v, v - u, 4);
}

double plate_height_m(PlateShape shape) {
  switch (shape) {
    case PlateShape::kWarning:
    case PlateShape::kGiveWay:
      return kTriangle_m * kTriangleHeight;
    case PlateShape::kStop:
      return 0.9;
    case PlateShape::kPriority:
      return 0.6 * std::numbers::sqrt2;
    case PlateShape::kNote:
      return 0.33;
    default:
      return 0.6;
  }
}

void add_plate(Mesh& mesh, PlateShape shape, const Eigen::Vector3d& low) {
  const double half_m = 0.5 * plate_height_m(shape);
  // Corners of a triangle are twice as far from its middle as its sides.
  const double far_m = 4.0 / 3.0 * half_m;
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY();
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
  switch (shape) {
    case PlateShape::kWarning:
      return add_plate(mesh, low + 0.5 * far_m * z, far_m * z, far_m * y, 3);
    case PlateShape::kGiveWay:
      return add_plate(mesh, low + far_m * z, -far_m * z, -far_m * y, 3);
    case PlateShape::kPriority:
      return add_plate(mesh, low + half_m * z, half_m * z, half_m * y, 4);
    case PlateShape::kStop: {
      // Its first corner lies half a side from the top's middle.
      const double aside_m = half_m * std::tan(std::numbers::pi / 8.0);
      return add_plate(mesh, low + half_m * z, half_m * z + aside_m * y, half_m * y - aside_m * z,
                       8);
    }
    case PlateShape::kSquare:
    case PlateShape::kNote:
      return add_board(mesh, low + half_m * z, -0.3 * y, half_m * z);
    default:
      return add_plate(mesh, low + half_m * z, half_m * z, half_m * y, 16);
  }
}

}  // namespace stillmap::simulation

#pragma once

#include <Eigen/Core>

#include "geometry/mesh.hpp"

/// Plates of traffic signs: bright film in front, bare metal 5 mm behind it.
namespace stillmap::simulation {

/// Plate with its corners at equal angles around `middle`, the first at `middle + u`. Its front
/// looks to where u x v points.
void add_plate(Mesh& mesh, const Eigen::Vector3d& middle, const Eigen::Vector3d& u,
               const Eigen::Vector3d& v, int corners);
/// Rectangular plate; `u` and `v` lead from its middle to the middles of its sides.
void add_board(Mesh& mesh, const Eigen::Vector3d& middle, const Eigen::Vector3d& u,
               const Eigen::Vector3d& v);

enum class PlateShape { kRound, kWarning, kGiveWay, kStop, kPriority, kSquare, kNote, kCount };
/// Height of such a plate [m].
[[nodiscard]] double plate_height_m(PlateShape shape);
/// Plate of the usual size for towns (after the German VwV-StVO, to §§ 39 to 43: size 2) with its
/// lower end there; looks to -x, at traffic that drives along +x.
void add_plate(Mesh& mesh, PlateShape shape, const Eigen::Vector3d& low);

}  // namespace stillmap::simulation

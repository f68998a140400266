#pragma once

#include "scenery/facade.hpp"

namespace stillmap::simulation {

enum class RoofKind { kGable, kHip, kFlat };

/// Roof over x in [0, width], y in [0, depth] of a frame whose y points away from the street [m].
struct RoofShape {
  RoofKind kind;
  double width, depth;
  /// Height of the walls' top, and rise per metre of the slopes.
  double eave_z, slope;
  /// How far it stands out over front and back, and over the sides.
  double eave_out, verge_out;

  [[nodiscard]] double ridge_z() const { return eave_z + 0.5 * depth * slope; }
};

/// The roof's ridge runs along x.
void add_roof(const WallPlane& frame, const RoofShape& roof, const FacadeStyle& style);
void add_chimney(const WallPlane& frame, const RoofShape& roof, Random& random);
/// House of one window on the slope towards the street.
void add_dormer(const WallPlane& frame, const RoofShape& roof, double middle_x,
                const FacadeStyle& style, Random& random);

}  // namespace stillmap::simulation

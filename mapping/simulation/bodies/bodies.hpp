#pragma once

#include <stillmap/maps/box.hpp>

#include <vector>

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

/// Kinds of things that can move.
enum class BodyKind {
  kSmallCar,
  kSaloon,
  kEstate,
  kSuv,
  kVan,
  kTruck,
  kArticulatedTruck,
  kBus,
  kTrailer,
  kMotorcycle,
  kMotorcyclist,
  kBicycle,
  kCyclist,
  kPedestrian,
};

/// Something that can move: x forward, y left, z up, standing on z = 0, the middle of its footprint
/// at the origin.
struct Body {
  BodyKind kind = BodyKind::kSaloon;
  maps::ObjectClass object_class = maps::ObjectClass::kCar;
  /// One for what is rigid. For who walks: first standing, then the phases of one stride (two
  /// steps) in order, at even parts of `stride_m`.
  std::vector<Mesh> postures;
  /// Way that one stride takes [m]; 0 for what is rigid.
  double stride_m = 0.0;
};

/// A body of a kind, with measures and proportions drawn within those of the road. What is painted
/// is `kPaint` at brightness 128 (its actor scales it), what is glass lets rays through to seats.
[[nodiscard]] Body make_body(BodyKind kind, Random& random);

}  // namespace stillmap::simulation

#include "bodies/bodies.hpp"

#include <utility>

#include "bodies/heavy_vehicle_bodies.hpp"
#include "bodies/person_bodies.hpp"
#include "bodies/two_wheeler_bodies.hpp"
#include "bodies/vehicle_bodies.hpp"

namespace stillmap::simulation {
namespace {

Body rigid(BodyKind kind, maps::ObjectClass object_class, Mesh mesh) {
  Body body{.kind = kind, .object_class = object_class, .postures = {}, .stride_m = 0.0};
  body.postures.push_back(std::move(mesh));
  return body;
}

}  // namespace

Body make_body(BodyKind kind, Random& random) {
  using maps::ObjectClass;
  switch (kind) {
    case BodyKind::kSmallCar:
    case BodyKind::kSaloon:
    case BodyKind::kEstate:
    case BodyKind::kSuv:
      return rigid(kind, ObjectClass::kCar, make_car(kind, random));
    case BodyKind::kVan:
      return rigid(kind, ObjectClass::kVan, make_van(random));
    case BodyKind::kTruck:
      return rigid(kind, ObjectClass::kTruck, make_truck(random));
    case BodyKind::kArticulatedTruck:
      return rigid(kind, ObjectClass::kTruck, make_articulated_truck(random));
    case BodyKind::kBus:
      return rigid(kind, ObjectClass::kBus, make_bus(random));
    case BodyKind::kTrailer:
      return rigid(kind, ObjectClass::kTrailer, make_trailer(random));
    case BodyKind::kMotorcycle:
      return make_motorcycle(random);
    case BodyKind::kMotorcyclist:
      return make_motorcyclist(random);
    case BodyKind::kBicycle:
      return make_bicycle(random);
    case BodyKind::kCyclist:
      return make_cyclist(random);
    case BodyKind::kPedestrian:
      return make_pedestrian(random);
  }
  return {};
}

}  // namespace stillmap::simulation

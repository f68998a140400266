#include <stillmap/maps/box.hpp>
#include <stillmap/maps/map_object.hpp>

#include <array>
#include <cmath>
#include <utility>

namespace stillmap::maps {
namespace {

constexpr std::array<std::pair<ObjectClass, std::string_view>, 10> kClassNames{{
    {ObjectClass::kCar, "car"},
    {ObjectClass::kVan, "van"},
    {ObjectClass::kTruck, "truck"},
    {ObjectClass::kBus, "bus"},
    {ObjectClass::kTrailer, "trailer"},
    {ObjectClass::kTram, "tram"},
    {ObjectClass::kMotorcycle, "motorcycle"},
    {ObjectClass::kCyclist, "cyclist"},
    {ObjectClass::kPedestrian, "pedestrian"},
    {ObjectClass::kUnknown, "unknown"},
}};

constexpr std::array<std::pair<ObjectMotion, std::string_view>, 3> kMotions{{
    {ObjectMotion::kUnknown, "unknown"},
    {ObjectMotion::kParked, "parked"},
    {ObjectMotion::kMoving, "moving"},
}};

}  // namespace

std::string_view name_of(ObjectClass object_class) {
  for (const auto& [value, name] : kClassNames) {
    if (value == object_class) return name;
  }
  return "unknown";
}

std::optional<ObjectClass> object_class_from(std::string_view name) {
  for (const auto& [value, known] : kClassNames) {
    if (known == name) return value;
  }
  return std::nullopt;
}

std::string_view name_of(ObjectMotion motion) {
  for (const auto& [value, name] : kMotions) {
    if (value == motion) return name;
  }
  return "unknown";
}

std::optional<ObjectMotion> object_motion_from(std::string_view name) {
  for (const auto& [value, known] : kMotions) {
    if (known == name) return value;
  }
  return std::nullopt;
}

bool Box::contains(const Eigen::Vector3d& p, double margin_m) const {
  const Eigen::Vector3d d = p - centre;
  const double c = std::cos(yaw_rad);
  const double s = std::sin(yaw_rad);
  const double along = c * d.x() + s * d.y();
  const double across = -s * d.x() + c * d.y();
  // Written so that a NaN anywhere is outside.
  return std::abs(along) <= 0.5 * size_m.x() + margin_m &&
         std::abs(across) <= 0.5 * size_m.y() + margin_m &&
         std::abs(d.z()) <= 0.5 * size_m.z() + margin_m;
}

}  // namespace stillmap::maps

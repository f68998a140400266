#include "evaluation/detector/class_groups.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

using enum maps::ObjectClass;

/// Boxes of small objects that are off by 0.3 m hardly overlap, so 0.5 says little of them.
const std::vector<double> kVehicleIous{0.3, 0.5, 0.7};
const std::vector<double> kSmallIous{0.3};

}  // namespace

bool ClassGroup::holds(maps::ObjectClass object_class) const {
  return std::find(members.begin(), members.end(), object_class) != members.end();
}

std::span<const ClassGroup> kinds() {
  static const std::array<ClassGroup, 3> groups{{
      {"vehicle", {kCar, kVan, kTruck, kBus, kTrailer, kTram}, kVehicleIous},
      {"two_wheeler", {kCyclist, kMotorcycle}, kSmallIous},
      {"pedestrian", {kPedestrian}, kSmallIous},
  }};
  return groups;
}

std::span<const ClassGroup> single_classes() {
  static const std::vector<ClassGroup> groups = [] {
    std::vector<ClassGroup> single;
    for (const ClassGroup& kind : kinds()) {
      if (kind.members.size() == 1) continue;
      for (const maps::ObjectClass member : kind.members)
        single.push_back({maps::name_of(member), {member}, kind.ious});
    }
    return single;
  }();
  return groups;
}

const ClassGroup& kind_of(const ClassGroup& group) {
  for (const ClassGroup& kind : kinds()) {
    if (kind.holds(group.members.at(0))) return kind;
  }
  throw std::invalid_argument(
      "class group: found one of no kind, expected a kind or a class of it");
}

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/maps/box.hpp>

#include <span>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Classes that are judged together: all of a kind, or one of them.
struct ClassGroup {
  std::string_view name;
  std::vector<maps::ObjectClass> members;
  /// Overlaps that average precision is asked for at.
  std::vector<double> ious;

  [[nodiscard]] bool holds(maps::ObjectClass object_class) const;
};

/// `vehicle`, `two_wheeler`, `pedestrian`: every class but `unknown` is in one of them.
[[nodiscard]] std::span<const ClassGroup> kinds();
/// The classes of kinds that have several.
[[nodiscard]] std::span<const ClassGroup> single_classes();
/// The kind that a group is, or is of.
[[nodiscard]] const ClassGroup& kind_of(const ClassGroup& group);

}  // namespace stillmap::mapping

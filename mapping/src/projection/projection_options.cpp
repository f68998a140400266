#include <fmt/format.h>
#include <stillmap/mapping/projection.hpp>

#include <stdexcept>

namespace stillmap::mapping {

MovablePolicy movable_policy_from(std::string_view text) {
  for (const MovablePolicy policy :
       {MovablePolicy::kProject, MovablePolicy::kDelete, MovablePolicy::kKeep}) {
    if (text == name_of(policy)) return policy;
  }
  throw std::invalid_argument(
      fmt::format("movable policy: found '{}', expected project, delete or keep", text));
}

std::string_view name_of(MovablePolicy policy) {
  switch (policy) {
    case MovablePolicy::kProject:
      return "project";
    case MovablePolicy::kDelete:
      return "delete";
    case MovablePolicy::kKeep:
      return "keep";
  }
  throw std::invalid_argument("movable policy: not one of the enumerators");
}

GroundHeight ground_height_from(std::string_view text) {
  for (const GroundHeight height : {GroundHeight::kLocal, GroundHeight::kMean}) {
    if (text == name_of(height)) return height;
  }
  throw std::invalid_argument(
      fmt::format("ground height: found '{}', expected local or mean", text));
}

std::string_view name_of(GroundHeight height) {
  switch (height) {
    case GroundHeight::kLocal:
      return "local";
    case GroundHeight::kMean:
      return "mean";
  }
  throw std::invalid_argument("ground height: not one of the enumerators");
}

std::vector<std::string> ProjectionOptions::violations() const {
  std::vector<std::string> broken;
  const auto check = [&](const char* name, double value, double highest) {
    if (!(value >= 0.0 && value <= highest))
      broken.push_back(fmt::format("{}: {}, expected in [0, {:g}]", name, value, highest));
  };
  check("margin_m", margin_m, 1.0);
  check("margin_up_m", margin_up_m, 2.0);
  check("half_sweep_s", half_sweep_s, 1.0);
  return broken;
}

}  // namespace stillmap::mapping

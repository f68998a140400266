#pragma once

#include <array>

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

/// A motorcycle or a scooter in its own frame: x forward, the wheels' middle at the origin, tyres
/// on z = 0 [m].
struct Motorcycle {
  enum class Style { kNaked, kTourer, kScooter };
  Style style = Style::kNaked;
  double wheel_radius_m = 0.305;
  double wheelbase_m = 1.44;
  double seat_height_m = 0.80;
  double grip_height_m = 1.06;
  bool top_box = false;
  double steering_rad = 0.0;
};

[[nodiscard]] Motorcycle draw_motorcycle(Random& random);

/// Where one sits.
[[nodiscard]] Eigen::Vector3d seat_of(const Motorcycle& motorcycle);
/// Left before right, with the steering straight.
[[nodiscard]] std::array<Eigen::Vector3d, 2> grips_of(const Motorcycle& motorcycle);
/// Where the soles are, left before right.
[[nodiscard]] std::array<Eigen::Vector3d, 2> pegs_of(const Motorcycle& motorcycle);

void add_motorcycle(Mesh& mesh, const Motorcycle& motorcycle);

}  // namespace stillmap::simulation

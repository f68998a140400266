#pragma once

#include <vector>

#include "bodies/vehicle_parts.hpp"

namespace stillmap::simulation {

/// What a truck or trailer carries its goods in.
enum class LoadKind { kBox, kTarpaulin, kTipper, kFlatBed };
[[nodiscard]] LoadKind draw_load_kind(Random& random);

/// Body for goods [m]: its stretch along x, the underside of its floor and its highest edge.
struct LoadBody {
  LoadKind kind = LoadKind::kBox;
  Stretch x;
  double half_width_m = 1.27;
  double floor_m = 1.1;
  double top_m = 3.6;
};
void add_load_body(Mesh& mesh, const LoadBody& body, Random& random);

/// Cab of a truck, its driver above the front axle [m].
struct Cab {
  double front_x = 0.0;
  double length_m = 2.0;
  double half_width_m = 1.2;
  double height_m = 2.9;
  double axle_x = 0.0;
  Wheel wheel;
};
void add_cab(Mesh& mesh, const Cab& cab, Random& random);

/// Two beams along x from the rear to the front, their upper side at `top_m`.
void add_frame(Mesh& mesh, const Stretch& x, double top_m);

/// Pairs of rails at both sides between axles, against people falling under the wheels (UN R73).
void add_side_guards(Mesh& mesh, const Stretch& x, double half_width_m);

/// Bar against cars driving under the rear (UN R58), with lamps and a number plate; `x` is its
/// rear side, `floor_m` where it hangs from.
void add_underrun_bar(Mesh& mesh, double x, double half_width_m, double floor_m);

/// Axles of a heavy vehicle, with twin wheels when the wheel is wide, and mudguards above them.
void add_rear_axles(Mesh& mesh, const std::vector<double>& xs, double half_width_m,
                    const Wheel& wheel);

}  // namespace stillmap::simulation

#pragma once

#include <stillmap/mapping/progress.hpp>

#include <cstdint>
#include <vector>

#include "bodies/bodies.hpp"
#include "roads/route.hpp"

namespace stillmap::simulation {

/// What drives, and how.
struct TrafficSpec {
  /// Mean distance between vehicles of a lane [m].
  double spacing_m = 70.0;
  /// Speed wished for where nothing is in the way [m/s], and its spread from one to the next.
  double speed_mps = 9.5;
  double speed_spread_mps = 1.5;
  /// Kinds, and how many of each among all.
  std::vector<std::pair<BodyKind, double>> mix;
  /// Changes lanes to pass what is slower (roads with several lanes).
  bool overtakes = false;
  /// Our own speed where nothing is in the way [m/s].
  double own_speed_mps = 8.5;
  /// There is traffic only so far from us [m], so that it costs as much in a large network as in a
  /// small one. 0 = everywhere.
  double vicinity_m = 0.0;
};

/// A vehicle of the traffic.
struct Driven {
  BodyKind kind = BodyKind::kSaloon;
  /// Of what is still to be drawn for it.
  std::uint64_t key = 0;
  Motion motion;
};

struct TrafficRun {
  /// Motions cover [-1, duration_s + 1] s, or less for those that come later or leave earlier.
  double duration_s = 10.0;
  /// Everything random follows from it.
  std::uint64_t key = 0;
  /// May be none.
  const mapping::CancelFlag* cancel = nullptr;
};

/// Vehicles that follow each other without touching (Treiber, Hennecke, Helbing, "Congested traffic
/// states in empirical observations and microscopic simulations", Phys. Rev. E 62, 2000:
/// intelligent driver model), slow down for bends, wait at crossings for their turn, pass cyclists
/// with a swerve and, where asked for, slower vehicles on the next lane.
///
/// @param own  our own route; the first of the result is our vehicle.
/// @throws mapping::Cancelled.
[[nodiscard]] std::vector<Driven> drive_traffic(const RoadNetwork& network, const Route& own,
                                                const TrafficSpec& spec, const TrafficRun& run);

}  // namespace stillmap::simulation

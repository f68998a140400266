#pragma once

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <functional>

namespace stillmap::mapping {

/// Rays that stay below this height over a box's bottom are not counted: they may pass under a
/// vehicle [m]. Who asks about a part of a vehicle sets the bottom so much lower.
inline constexpr double kRayFloorM = 0.35;

/// What the rays of one scan that head for a box met.
struct BoxRays {
  /// Ended inside the box.
  std::size_t inside = 0;
  /// Passed through it and ended beyond it: nothing stood there on their way.
  std::size_t through = 0;
  /// Ended before it: the box could not be seen there.
  std::size_t before = 0;

  BoxRays& operator+=(const BoxRays& other) {
    inside += other.inside;
    through += other.through;
    before += other.before;
    return *this;
  }
};

/// @param scan  ordinal of a scan. @param box  in that scan's lidar frame. Safe from several
/// threads.
using BoxRayCounter = std::function<BoxRays(std::size_t scan, const maps::Box& box)>;

}  // namespace stillmap::mapping

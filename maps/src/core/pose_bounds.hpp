#pragma once

namespace stillmap::maps {

// What 3 decimals of a rotation matrix or quaternion can be off; beyond it, the numbers mean
// something else.
inline constexpr double kMaxOffRotation = 1e-3;
// Far beyond any place on Earth in any frame; what is made of such positions stays finite [m].
inline constexpr double kMaxPositionM = 1e9;

}  // namespace stillmap::maps

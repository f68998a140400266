#pragma once

#include "cleaning/free_evidence.hpp"

#include <Eigen/Core>

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Which cells of a map moved, from how much speaks for it in each and around it.
///
/// An object is many cells that lie together, so their scores are averaged over a ball. A ball in
/// which few others go keeps its own: single cells between static ones are noise of a wall or a
/// twig. A cell among many that go goes with them, as the roof of a lorry against the sky.
/// Something thin that stands upright needs more: a ray passes it by a finger's breadth, so poses
/// that are off by centimetres let views see it free, and while what moves is as thin at times
/// (walkers), it is seen free for longer.
/// @param positions  M points [m], z up. @param evidence  M answers of the views.
/// @param ball_m     radius within which cells belong together.
/// @return M flags, 1 = moved; each follows from what lies within `kMovedReachBalls` balls of it.
[[nodiscard]] std::vector<std::uint8_t> moved_cells(std::span<const Eigen::Vector3f> positions,
                                                    std::span<const FreeEvidence> evidence,
                                                    float ball_m);

/// Two for what is thin (one for the mean), one for lonely cells, the rest for growing.
inline constexpr int kMovedReachBalls = 6;

}  // namespace stillmap::mapping

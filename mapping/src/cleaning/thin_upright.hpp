#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Which cells are part of something thin that stands upright: a pole, a trunk, the post of a sign.
/// Within 0.25 m to the side of such a cell something lies in four of five slices of 0.25 m, over
/// 1.25 m of height or more that the cell is part of, and in the ring from there to 0.6 m there is
/// at most a fifth as much.
/// @param positions  M points [m], z up. @param wanted  M flags; the others are not looked at.
/// @return M flags; each follows from what lies within 0.6 m to the side and 1.25 m above and
/// below.
[[nodiscard]] std::vector<std::uint8_t> thin_upright(std::span<const Eigen::Vector3f> positions,
                                                     std::span<const std::uint8_t> wanted);

}  // namespace stillmap::mapping

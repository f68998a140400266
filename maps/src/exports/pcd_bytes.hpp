#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <string>
#include <vector>

#include "exports/output_file.hpp"

namespace stillmap::maps {

/// Header of a binary PCD of 32-bit floats x y z intensity, as the fewest readers stumble over it:
/// no padding, COUNT 1, no viewpoint.
/// @param kinds     whether a byte `kind` follows each point.
/// @param comments  without line breaks.
[[nodiscard]] std::string pcd_header(std::uint64_t points, bool kinds,
                                     const std::vector<std::string>& comments);

void put_pcd_point(OutputFile& file, const Eigen::Vector3f& p, float intensity);

}  // namespace stillmap::maps

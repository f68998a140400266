#pragma once

#include <stillmap/mapping/odometry_table.hpp>

#include <vector>

namespace stillmap::mapping {

/// Mean of the values with Student's 95 % interval; NaN bounds of one value, all NaN of none.
[[nodiscard]] Interval mean_interval(const std::vector<double>& values);

/// Projected and deleted less raw, drive by drive, by method and without and with loops. Drives on
/// which one of the two is not known are left out and not counted.
[[nodiscard]] std::vector<OdometryTableDifference> differences_of(
    const std::vector<OdometryTableRun>& runs);

}  // namespace stillmap::mapping

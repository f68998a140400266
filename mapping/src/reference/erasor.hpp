#pragma once

#include <stillmap/mapping/cleaning.hpp>

namespace stillmap::mapping {

/// ERASOR: where the map is much taller than the scan that stands in it, the map's points go but
/// for the ground.
///
/// Reproduced, with the numbers of the authors' program for KITTI 00 (`config/seq_00.yaml`):
/// - Volume of interest around the vehicle, 80 m, from 1.3 m below to 3 m above the ground below
///   the sensor; region-wise pseudo occupancy descriptor (R-POD) of 20 rings and 108 sectors for
///   the scan and for the map.
/// - Pseudo occupancy of a bin, its highest less its lowest point; scan ratio test: a bin of the
///   map is dynamic when the ratio is below 0.2 (the program's number until 2026-05, 0.1 since) and
///   the map is the taller one. Bins with fewer than 6 points of the scan (in voxels of 0.2 m)
///   decide nothing, and the map must stand out by 0.5 m (version 3 of the program; not in the
///   paper).
/// - Bin-wise removal with R-GPF: ground stays (`region_ground`), and so does what the scan itself
///   sees in the bin.
/// - Every fourth scan in turn (`removal_interval`), each against the map that those before left.
///
/// Departures:
/// - The height of the sensor comes from each scan's ground points within 10 m; the program has it
///   from its configuration. Scans without such points are left out.
/// - What the scan itself sees stays as map points in whose voxel the scan has a point; the program
///   adds the scan's own points to the map.
/// - The "blocked" bins of the program's version 3 change nothing in the map, so they are left out.
///
/// Speed: blocks of map points that touch no bin which could be dynamic are not looked at, which
/// leaves the result as it is; scans are read ahead in parallel, compared one after the other.
/// @see Lim, Hwang, Myung, "ERASOR: Egocentric Ratio of Pseudo Occupancy-Based Dynamic Object
///      Removal for Static 3D Point Cloud Map Building", RA-L 6(2), 2021.
class Erasor : public Cleaner {
 public:
  [[nodiscard]] std::vector<std::uint8_t> moved(const CleaningPoints& points,
                                                const ScanSource& scans,
                                                const ProgressCallback& progress,
                                                const CancelFlag& cancel) const override;
};

}  // namespace stillmap::mapping

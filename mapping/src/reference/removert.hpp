#pragma once

#include <stillmap/mapping/cleaning.hpp>

namespace stillmap::mapping {

/// Removert: map points that stand in front of what a scan saw go, in passes from fine to coarse
/// pixels; then those of them that agree with the scans in still larger pixels come back.
///
/// Reproduced:
/// - Range images of scan and map with the nearest range in each pixel, section III of the paper. A
///   map point that is nearest in its pixel is dynamic when the scan's range there exceeds its own
///   by more than 0.05 of the scan's range (`adaptive_coeff` of the authors' program).
/// - *Remove*: every scan against the map that the passes before have left; one scan's objection is
///   enough. Pixels of 1, 1.14 and 1.25 ring spacings: `remove_resolution_list` 2.5, 2.2, 2.0
///   pixels a degree for an HDL-64E, with which others compared themselves (DynamicMap_Benchmark,
///   ERASOR). The program's own default, 2.5, 2.0, 1.5, keeps more and misses more.
/// - *Revert*: every scan against what was removed alone, with pixels of 1.375 ring spacings
///   (0.55 deg, the next of that series). A point that is nearest in its pixel and within 0.05 of
///   the scan's range comes back, unless another scan objects to it. The program leaves
///   `revertOnce` empty.
///
/// Departures:
/// - Discrepancies are signed, as in the paper; the program of Removert takes absolute values,
/// which
///   its authors call wrong in LT-mapper.
/// - Pixels follow the ring spacing, found from the first scan with points: the authors advise to
///   set that by hand for each sensor.
/// - Directions above and below all points of a scan are left out. The program piles them up in the
///   first and last row, where they are compared with other directions.
/// - Map points are voxel means of the map as it is (the authors advise voxels of 0.05 m).
/// - In LT-mapper, the authors' later program, points come back as well that no scan compares,
/// which
///   are most of a dense trail.
/// - Scans are not cleaned by their neighbours in the clean map (`removeDynamicPointsOfScanByKnn`):
///   our maps are cleaned by points.
///
/// Speed: blocks of map points that lie behind all a scan saw are not projected, which leaves the
/// result as it is. Memory: about 0.8 MiB for each scan of an HDL-64E.
/// @see Kim, Kim, "Remove, then Revert: Static Point cloud Map Construction using Multiresolution
///      Range Images", IROS 2020.
class Removert : public Cleaner {
 public:
  [[nodiscard]] std::vector<std::uint8_t> moved(const CleaningPoints& points,
                                                const ScanSource& scans,
                                                const ProgressCallback& progress,
                                                const CancelFlag& cancel) const override;
};

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/mapping/cleaning.hpp>

namespace stillmap::mapping {

/// Removert: map points that stand in front of what a scan saw go, in passes from fine to coarse
/// pixels; then those of them that agree with the scans in still larger pixels come back.
///
/// Reproduced:
/// - Range images of scan and map with the nearest range in each pixel. A map point that is nearest
///   in its pixel is dynamic when the scan's range there exceeds its own by more than 0.05 of the
///   scan's range (`adaptive_coeff` of the authors' program).
/// - *Remove*: every scan against the map that the passes before have left; one scan's objection is
///   enough. Pixels of 1, 1.14 and 1.25 ring spacings: `remove_resolution_list` 2.5, 2.2, 2.0
///   pixels a degree for an HDL-64E, with which others compared themselves (DynamicMap_Benchmark,
///   ERASOR). The program's own default, 2.5, 2.0, 1.5, keeps more and misses more.
///
/// Departures:
/// - *Revert* is ours, after the abstract alone: the program has none (`revertOnce` is empty, its
///   README says that the step is left out). Once, at the end, every scan meets what was removed
///   alone, with pixels of 1.375 ring spacings (0.55 deg); a point that is nearest in its pixel and
///   within 0.05 of the scan's range comes back, unless another scan objects to it. The program's
///   configuration lists four passes with pixels of 1.0 to 1.4 deg, to no effect, and advises to
///   begin with 0.7 to 1 deg. LT-mapper, the authors' later program, reverts after each removal
///   with pixels a 20th larger, then removes again; there, points come back as well that no scan
///   compares, which are most of a dense trail.
/// - All scans are asked as they are. The program takes every fifth (`keyframe_gap`) and means of
///   voxels of 0.05 m.
/// - Discrepancies are signed; the program takes absolute values, which LT-mapper calls wrong.
/// - Pixels follow the ring spacing, found from the first scan with points: the authors advise to
///   set that by hand for each sensor.
/// - Directions above and below all points of a scan are left out. The program piles them up in the
///   first and last row, where they are compared with other directions.
/// - Map points are voxel means of the map as it is (the authors advise voxels of 0.05 m).
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

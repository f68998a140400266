#pragma once

#include <stillmap/mapping/cleaning.hpp>

namespace stillmap::mapping {

/// Removert: map points that stand in front of what a scan saw go; those of them that coarser
/// pixels do not object to come back; then what still stands in front goes again.
///
/// Reproduced:
/// - Range images of scan and map with the nearest range in each pixel, section III of the paper. A
///   map point that is nearest in its pixel is dynamic when the scan's range there exceeds its own
///   by more than 0.05 of the scan's range (`adaptive_coeff` of the program). One scan's objection
///   is enough.
/// - *Remove*: all scans against the map with pixels of 0.4 deg for an HDL-64E, which is one ring
///   spacing (`remove_resolution_list` 2.5 pixels a degree).
/// - *Revert*: all scans against what was removed alone, with larger pixels (0.95 of that
///   resolution); what no scan objects to comes back.
/// - *Remove* once more. Order, resolutions and the use of every keyframe are those of
///   `selfRemovert` and `params_ltmapper.yaml` in the authors' LT-mapper: the program of Removert
///   itself leaves `revertOnce` empty, and removes at 2.5, 2.0 and 1.5 pixels a degree instead.
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
/// - Scans are not cleaned by their neighbours in the clean map (`removeDynamicPointsOfScanByKnn`):
///   our maps are cleaned by points.
///
/// Speed: blocks of map points that lie behind all a scan saw are not projected, which leaves the
/// result as it is. Memory: about 0.5 MiB for each scan of an HDL-64E.
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

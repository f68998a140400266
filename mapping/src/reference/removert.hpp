#pragma once

#include <stillmap/mapping/cleaning.hpp>

namespace stillmap::mapping {

/// Removert: points that stand in front of what a scan saw go, in several passes from fine to
/// coarse pixels, and those of them that coarser pixels do not object to come back.
///
/// Reproduced, with the equations of the paper's section III:
/// - Range images of scan and map with the nearest range in each pixel, eq. (2); a map point that
///   is nearest in its pixel is dynamic when the scan's range there exceeds its own by more than
///   tau = 0.05 of the scan's range, eq. (3), (4) (`adaptive_coeff` of the authors' program).
/// - *Remove*: pixels of 1, 1.25 and 5/3 ring spacings, which is the `remove_resolution_list` 2.5,
///   2.0, 1.5 pixels a degree at an HDL-64E's 0.4 deg. In each pass every scan is compared with the
///   map that the passes before have left; one scan's objection is enough.
/// - *Revert*: the same comparison of what was removed alone, at coarser pixels (1 pixel a degree,
///   the first of `revert_resolution_list`, 2.5 ring spacings); what no scan objects to comes back
///   (`revertOnce` of the authors' later LT-mapper; the program of Removert leaves it empty).
///
/// Departures:
/// - Discrepancies are signed, as in the paper; the program takes absolute values, which the
///   authors call wrong in LT-mapper.
/// - Pixels grow with the ring spacing, found from the first scan with points: the authors advise
///   to set it by hand for each sensor.
/// - Directions above and below all points of a scan are left out. The program piles them up in the
///   first and last row, where they are compared with other directions.
/// - Map points are voxel means of the map as it is (the authors advise voxels of 0.05 m). Every
///   scan of the map is used: the program builds its map from every fifth scan and uses those.
/// - No static scans are made by neighbours: our maps are cleaned by points.
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

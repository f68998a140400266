#pragma once

#include "evaluation/detector/class_groups.hpp"

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/labelled_boxes.hpp>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stillmap::mapping {

struct TruthBox {
  maps::Box box;
  /// Of the scan inside.
  std::size_t points = 0;
};

/// Labels and boxes of one scan.
struct ScanBoxes {
  std::size_t scan = 0;
  std::vector<TruthBox> truths;
  std::vector<maps::Box> found;
  /// One a found box: whether it would carry a label if it were an object.
  std::vector<std::uint8_t> in_sight;
};

/// Which truth counts: that of `min_points` or more with its centre `from_m` <= r < `to_m` from the
/// sensor.
struct Window {
  double from_m = 0.0;
  double to_m = 50.0;
  std::size_t min_points = 5;

  [[nodiscard]] bool holds(const maps::Box& box) const;
  [[nodiscard]] bool counts(const TruthBox& truth) const;
};

enum class Verdict : std::uint8_t {
  kOther,    ///< not of these classes, or of too low a score
  kTrue,     ///< the one box of a label that counts
  kFalse,    ///< a second box of it too
  kIgnored,  ///< on a label that does not count, out of the window or of sight
};

struct ScanMatch {
  /// One a truth: whether it is of these classes and counts, and whether it was found.
  std::vector<std::uint8_t> counts, is_found;
  /// One a found box.
  std::vector<Verdict> verdicts;
};

/// Distance of centres that counts as found [m].
inline constexpr double kCentreReachM = 1.5;

/// Boxes of falling score take the free label that they overlap most, by `min_iou` or more seen
/// from above.
[[nodiscard]] ScanMatch match_by_overlap(const ScanBoxes& boxes, const ClassGroup& group,
                                         const Window& window, double min_iou);

/// Boxes of `min_score` or more and labels whose centres are within `kCentreReachM` of each other
/// seen from above, nearest first.
[[nodiscard]] ScanMatch match_by_centre(const ScanBoxes& boxes, const ClassGroup& group,
                                        const Window& window, double min_score = 0.0);

/// Whether a box would carry a label if it were an object: its centre is in the image, and less
/// than half of its outline in any one region without labels.
[[nodiscard]] bool would_be_labelled(const maps::Box& box, const maps::CameraView& view);

}  // namespace stillmap::mapping

#pragma once

#include "evaluation/labels/semantic_classes.hpp"

#include <stillmap/mapping/detector_evaluation.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Class of each point of a scan; `no_class()` where there is none.
/// @param labels  one a point of the scan's file.
/// @throws maps::InputError for labels that are no classes.
[[nodiscard]] std::vector<ClassIndex> classes_of(const maps::Scan& scan,
                                                 const std::vector<std::uint32_t>& labels);

/// Counts labelled points inside of boxes, scan by scan; `margin_m` to every side belongs to a box.
class PointTally {
 public:
  PointTally(double max_range_m, double margin_m)
      : max_range_m_(max_range_m), margin_m_(margin_m) {}

  /// @param classes, is_ground  one a point.
  void add(const maps::PointCloud& cloud, const std::vector<ClassIndex>& classes,
           const std::vector<std::uint8_t>& is_ground, const std::vector<maps::Box>& boxes);

  [[nodiscard]] PointDetection result() const;

 private:
  double max_range_m_;
  double margin_m_;
  std::size_t scans_ = 0;
  Share stays_above_ground_;
  /// By position in `semantic_classes()`.
  std::array<Share, 256> by_class_{};
};

/// The class that most of a box's points have, those of ground and of no known class left out;
/// "nothing" for a box without such points.
[[nodiscard]] std::string content_of(const maps::Box& box, const maps::PointCloud& cloud,
                                     const std::vector<ClassIndex>& classes,
                                     const std::vector<std::uint8_t>& is_ground);

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/mapping/detector.hpp>
#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/localization_evaluation.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>

#include <cstddef>
#include <memory>
#include <vector>

namespace stillmap::mapping {

/// The scans of a drive as they are asked for: deskewed as the options say, and what could move
/// deleted or put onto the scan's own ground where they do.
class QueryScans {
 public:
  /// @param drive    must outlive this.
  /// @param options  as far as `query_deskew`, `query_movable` and `query_detector` go.
  /// @param scans    those that will be asked for; some of them teach the ground stage.
  /// @throws as `make_detector`, and what reading a scan throws.
  QueryScans(const maps::Drive& drive, const LocalizationEvaluationOptions& options,
             const std::vector<std::size_t>& scans, const CancelFlag& cancel);

  /// @param points  of this scan are added to it.
  /// @note  Safe from several threads, with a count of each thread's own.
  [[nodiscard]] maps::PointCloud read(std::size_t index, QueryPoints& points) const;

 private:
  [[nodiscard]] maps::Scan read_for_query(std::size_t index) const;

  const maps::Drive& drive_;
  QueryDeskew deskew_;
  MovablePolicy movable_;
  /// None where everything is kept.
  std::unique_ptr<GroundSegmenter> ground_;
  std::unique_ptr<Detector> detector_;
};

}  // namespace stillmap::mapping

#pragma once

#include "stacking/static_map.hpp"

#include <stillmap/mapping/detector.hpp>
#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// What one scan gives to the map.
struct ProcessedScan {
  std::size_t index = 0;
  std::vector<StackedPoint> points;
  /// Number in `objects` plus 1 of each point's object, or 0.
  std::vector<std::uint32_t> object_of_point;
  std::vector<maps::MapObject> objects;
  std::map<std::string, std::uint64_t> counts;
  std::map<std::string, double> stage_seconds;
  /// Of the scan's file, lower-case hex.
  std::string sha256;
};

/// Everything that is done to one scan, a pure function of the drive and the options.
/// Safe from several threads.
class ScanStages {
 public:
  ScanStages(const maps::Drive& drive, const MapBuildOptions& options);

  [[nodiscard]] ProcessedScan process(std::size_t index) const;
  [[nodiscard]] const Detector& detector() const { return *detector_; }

 private:
  const maps::Drive& drive_;
  const MapBuildOptions& options_;
  std::unique_ptr<GroundSegmenter> ground_;
  std::unique_ptr<Detector> detector_;
};

/// A scan as the stages after reading see it: only points between the two ranges, deskewed where
/// the drive tells how.
/// @param counts  `dropped_too_near` and `dropped_too_far` are added to.
[[nodiscard]] maps::Scan read_deskewed(const maps::Drive& drive, std::size_t index,
                                       const std::array<double, 2>& range_m,
                                       std::map<std::string, std::uint64_t>& counts);

}  // namespace stillmap::mapping

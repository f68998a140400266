#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <cstddef>
#include <cstdint>
#include <string>

namespace stillmap::maps {

/// Where a path has no poses for over a second.
class PoseGaps {
 public:
  /// @param path  outlives this.
  explicit PoseGaps(const Trajectory& path);

  enum class Place {
    kKnown,    ///< in no gap
    kBridged,  ///< the poses are as far apart everywhere, or the sensor stood still
    kUnknown,  ///< a gap in dense poses, over which the sensor moved: a straight line may be metres
               ///< off
  };
  [[nodiscard]] Place of(std::int64_t stamp_ns) const;

 private:
  const Trajectory& path_;
  /// Least time between poses that is a gap among them.
  std::uint64_t least_ns_;
};

/// Scans that lie in gaps, for the notes of a drive.
struct ScansInGaps {
  std::size_t bridged = 0, left_out = 0;
  /// Counts a scan. @return whether it has a place.
  bool add(PoseGaps::Place place);
  /// @param source  of the poses.
  void note(Drive::Contents& contents, const std::string& source) const;
};

}  // namespace stillmap::maps

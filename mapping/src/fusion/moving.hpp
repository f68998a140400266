#pragma once

#include "fusion/evidence.hpp"
#include "fusion/place_look.hpp"
#include "fusion/standing.hpp"
#include "fusion/track.hpp"

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// An object that went somewhere.
struct MovingObject {
  /// Class and size of the whole object.
  maps::Box box;
  Evidence evidence;
  /// By scan: hits, the scans between them, and some before and after.
  std::vector<ObjectPlacement> placements;
};

/// A candidate for an object that went somewhere, smoothed over its whole way, before the scans
/// along it were asked.
class MovingCase {
 public:
  /// @param drive_scans  ordinals of all scans of the track's drive, in order.
  MovingCase(Track track, const std::vector<DetectedScan>& scans,
             const std::vector<std::size_t>& drive_scans);

  [[nodiscard]] const Track& track() const { return track_; }
  [[nodiscard]] std::vector<PlaceQuestion> questions() const;
  [[nodiscard]] MovingObject concluded(std::span<const PlaceLook> answers) const;

  /// The hits before it set off and after it stopped; none where it was in motion. Standing cases
  /// of their own, whose scans beyond the track's are the object's too.
  [[nodiscard]] const Track& came_from() const { return came_from_; }
  [[nodiscard]] const Track& stopped_at() const { return stopped_at_; }
  void add_standing_end(const StandingObject& stood, bool at_begin, MovingObject& object) const;

 private:
  Track track_;
  maps::Box whole_;
  std::vector<ObjectPlacement> placements_;
  /// One a placement: log odds of its score, if it was detected.
  std::vector<double> opinions_;
  Track came_from_, stopped_at_;
};

}  // namespace stillmap::mapping

#pragma once

#include "fusion/evidence.hpp"
#include "fusion/place_look.hpp"
#include "fusion/track.hpp"

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <span>
#include <utility>
#include <vector>

namespace stillmap::mapping {

/// An object that stood still during a drive.
struct StandingObject {
  maps::Box box;
  Evidence evidence;
  /// Scans in which it was there and may have points, in order, with whether it was detected.
  std::vector<std::pair<std::size_t, bool>> scans;
};

/// A candidate for an object that stood still, before the scans around it were asked.
class StandingCase {
 public:
  StandingCase(Track track, const PlaceLooks& looks);

  [[nodiscard]] const Track& track() const { return track_; }
  /// All scans near enough to have seen it, then some of other drives.
  [[nodiscard]] std::vector<PlaceQuestion> questions() const;
  [[nodiscard]] StandingObject concluded(std::span<const PlaceLook> answers) const;

 private:
  /// A scan near the place.
  struct View {
    std::size_t scan = 0;
    double weight = 0.0;
    /// What its box says; with `hit` only.
    double opinion = 0.0;
    bool hit = false;
    /// Near enough that finding nothing means something.
    bool near = false;
  };
  void find_views(const PlaceLooks& looks);
  void find_other_days(const PlaceLooks& looks);
  [[nodiscard]] std::vector<bool> times_gone(std::span<const PlaceLook> answers) const;
  [[nodiscard]] bool free_on_another_day(std::span<const PlaceLook> answers) const;

  Track track_;
  /// One, in a vector so that it stays where it is.
  std::vector<maps::Box> box_;
  std::vector<View> views_;
  /// Scans of each other drive that are asked, one after the other.
  std::vector<std::vector<std::size_t>> other_days_;
};

}  // namespace stillmap::mapping

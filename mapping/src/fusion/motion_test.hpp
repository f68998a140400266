#pragma once

#include "fusion/place_look.hpp"
#include "fusion/track.hpp"

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Whether a track went somewhere: farther than the box of a parked car jumps between its corners,
/// and the place it left, or had not reached yet, was seen free. Given tracks are believed.
class MotionTest {
 public:
  /// @param track  must stay where it is as long as the test.
  explicit MotionTest(const Track& track);
  /// What has to be looked at before the answer.
  [[nodiscard]] std::vector<PlaceQuestion> questions() const;
  [[nodiscard]] bool moved(std::span<const PlaceLook> answers) const;

 private:
  /// Hits that follow each other.
  struct Window {
    std::size_t begin = 0, end = 0;
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  };
  [[nodiscard]] std::vector<Window> windows() const;
  void find_ends(const std::vector<Window>& windows);
  [[nodiscard]] maps::Box box_of(const Window& window) const;

  const Track& track_;
  /// The two windows that are farthest apart, and how far [m].
  Window early_, late_;
  double farthest_m_ = 0.0;
  double least_m_ = 0.0;
  double length_m_ = 0.0;
  /// Of both windows; empty when the distance settles it.
  std::vector<maps::Box> boxes_;
};

}  // namespace stillmap::mapping

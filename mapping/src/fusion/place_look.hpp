#pragma once

#include "fusion/object_fusion.hpp"

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/cell_table.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// What a scan says about a place where an object may have stood.
enum class PlaceState : std::uint8_t {
  kHidden,    ///< nothing: too few rays reached it
  kOccupied,  ///< something was there
  kFree,      ///< rays went through where its body would have been
};

struct PlaceLook {
  PlaceState state = PlaceState::kHidden;
  /// Rays that ended at the height of its body in and right around it.
  std::size_t on_body = 0;
  /// Whether any ray ended in the whole box.
  bool has_points = false;
};

/// A place to be looked at in one scan.
struct PlaceQuestion {
  std::size_t scan = 0;
  /// Map frame; not owned, since many scans are asked about one box.
  const maps::Box* box = nullptr;
};

/// The scans as witnesses: which of them were near a place, and what they saw there.
class PlaceLooks {
 public:
  PlaceLooks(const std::vector<DetectedScan>& scans, const BoxRayCounter& count_rays);

  /// Free is a place where several rays passed the core, which no car lets through at the height of
  /// its body, and four times as many as ended in or right around the box. Measured on simulated
  /// cars with boxes 0.3 m off: an occupied place looks free in 0.7 % of the scans, a free one does
  /// not in 2 %.
  ///
  /// Asked scan by scan, since a scan's rays may have to be read from a file.
  /// @return one a question, in their order.
  [[nodiscard]] std::vector<PlaceLook> answers(const std::vector<PlaceQuestion>& questions) const;

  /// Scans of one drive whose sensor was within `reach_m` of a place, in order.
  [[nodiscard]] std::vector<std::size_t> scans_near(std::size_t drive, const Eigen::Vector2d& place,
                                                    double reach_m) const;
  /// From the sensor to a place, from above [m].
  [[nodiscard]] double distance_m(std::size_t scan, const Eigen::Vector2d& place) const;
  /// Between the sensor's places of two scans [m].
  [[nodiscard]] double travel_m(std::size_t scan_a, std::size_t scan_b) const;
  [[nodiscard]] std::size_t drives() const { return cells_.size(); }

 private:
  [[nodiscard]] PlaceLook look(const PlaceQuestion& question) const;

  const std::vector<DetectedScan>& scans_;
  const BoxRayCounter& count_rays_;
  /// By drive, then by cell: scans whose sensor was there.
  std::vector<maps::CellMap<std::vector<std::size_t>>> cells_;
};

}  // namespace stillmap::mapping

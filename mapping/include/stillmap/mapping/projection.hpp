#pragma once

#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/point_fates.hpp>
#include <stillmap/maps/scan.hpp>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// What happens to points of movable objects.
enum class MovablePolicy { kProject, kDelete, kKeep };
/// @throws std::invalid_argument naming the text and the choices.
[[nodiscard]] MovablePolicy movable_policy_from(std::string_view text);
[[nodiscard]] std::string_view name_of(MovablePolicy policy);

struct ProjectionOptions {
  MovablePolicy policy = MovablePolicy::kProject;
  /// Boxes are grown by this on every side [m], in [0, 1]. More takes mirrors and antennas, and
  /// neighbours.
  double margin_m = 0.1;

  [[nodiscard]] std::vector<std::string> violations() const;
};

using maps::PointFate;

struct ProjectionResult {
  /// N new positions; equal to the old ones but for `kProjected`.
  std::vector<Eigen::Vector3f> positions;
  std::vector<PointFate> fates;
  /// N numbers: index of the box plus 1 for points of an object, else 0.
  std::vector<std::uint32_t> object_of_point;
  /// Points by fate.
  std::size_t ground = 0, projected = 0, deleted = 0, kept = 0;
  /// Points inside a box with no ground known below: deleted (under `kProject`), counted here too.
  std::size_t without_ground = 0;
};

/// Stage "project": points inside a *rotated* box (with margin) that are not ground go straight
/// down to the local ground surface (`kProject`), are dropped (`kDelete`) or stay (`kKeep`).
///
/// After Woo, Jung, Kim, "No More Potentially Dynamic Objects", eq. (8) to (12). Departs from it:
/// the local surface instead of the scan's mean height (eq. 10), only points in boxes are moved
/// (eq. 11 as printed flattens every non-ground point), boxes turn about their own centre with
/// length along the heading (eq. 5 and 7 as printed turn the vertices about the sensor with width
/// along x).
/// @throws std::invalid_argument on broken options, sizes that differ, or a box that is not finite.
[[nodiscard]] ProjectionResult project_objects(const maps::PointCloud& cloud,
                                               const GroundResult& ground,
                                               const std::vector<maps::Box>& boxes,
                                               const ProjectionOptions& options);

}  // namespace stillmap::mapping

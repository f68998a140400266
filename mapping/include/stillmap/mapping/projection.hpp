#pragma once

#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/ground_below.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/point_fates.hpp>
#include <stillmap/maps/scan.hpp>

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// What happens to points of movable objects.
enum class MovablePolicy { kProject, kDelete, kKeep };
/// @throws std::invalid_argument naming the text and the choices.
[[nodiscard]] MovablePolicy movable_policy_from(std::string_view text);
[[nodiscard]] std::string_view name_of(MovablePolicy policy);

/// Which ground a point goes down to: what is straight below it, or the scan's mean (the paper).
enum class GroundHeight { kLocal, kMean };
/// @throws std::invalid_argument naming the text and the choices (`local`, `mean`).
[[nodiscard]] GroundHeight ground_height_from(std::string_view text);
[[nodiscard]] std::string_view name_of(GroundHeight height);

/// An object as projection takes it.
struct MovableBox {
  /// Lidar frame at the scan's stamp.
  maps::Box box;
  /// Along the heading, over ground [m/s]; the box is drawn out by what it moves within half a
  /// sweep.
  double speed_mps = 0.0;
};

struct ProjectionOptions {
  MovablePolicy policy = MovablePolicy::kProject;
  GroundHeight ground_height = GroundHeight::kLocal;
  /// Boxes are grown by this to every side [m], in [0, 1]. More takes mirrors and antennas, and
  /// neighbours. Not used by `GroundHeight::kMean`.
  double margin_m = 0.1;
  /// And by this upward [m], in [0, 2]. More takes aerials, and roofs of boxes that are too low.
  /// Not used by `GroundHeight::kMean`.
  double margin_up_m = 0.25;
  /// Half the time that one sweep takes [s], in [0, 1]; 0 when all points are of one instant.
  double half_sweep_s = 0.05;
  /// Objects of these classes are movable; the others' boxes are passed over. Empty = all.
  std::vector<maps::ObjectClass> classes = {};

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
  /// Points labelled ground that were found to stand over it, so object.
  std::size_t ground_taken_back = 0;
};

/// Stage "project": points of movable objects go straight down to the ground below them
/// (`kProject`), are dropped (`kDelete`) or stay (`kKeep`).
///
/// A point is an object's when it lies within the *rotated* box, grown by the margins, and above
/// the ground:
///  - labelled ground and no more than the foot's tolerance over it: ground, stays;
///  - labelled ground and higher: a tyre or an underside that segmentation took for ground, object;
///  - not labelled and within 5 cm of the ground, over or under: ground, stays;
///  - farther below the ground, or more than 3.5 m over it: stays (a crown, a bridge), unless
///    the object is a truck, a bus, a trailer or a tram: then up to the box's own top.
/// A box is taken to reach down to the ground when it ends up to 0.6 m above it. Where boxes
/// overlap the first takes the point.
///
/// After Woo, Jung, Kim, "No More Potentially Dynamic Objects", eq. (8) to (12). Under
/// `GroundHeight::kMean` it is the paper's text: every point in a box without margins that is not
/// labelled ground gets the mean z of the scan's ground points. The printed equations say something
/// else: eq. (5) and (7) turn the vertices about the sensor with width along x (here: about the
/// box's centre, length along the heading), eq. (10) is a mean of points (here: of their heights),
/// eq. (11) flattens every point that is not ground (here: those in boxes).
/// `kLocal` departs from the text too: the ground straight below instead of the mean, margins,
/// and the rules above.
/// @param is_ground  N flags, 1 = ground.
/// @param below      used by `kLocal` alone.
/// @throws std::invalid_argument on broken options, sizes that differ, or a box that is not finite
/// or has a centre, a size or a speed beyond 1e8 (m, m/s).
[[nodiscard]] ProjectionResult project_objects(const maps::PointCloud& cloud,
                                               const std::vector<std::uint8_t>& is_ground,
                                               const GroundBelow& below,
                                               std::span<const MovableBox> boxes,
                                               const ProjectionOptions& options);

/// The same with the surface of the scan itself and boxes that stand still.
/// @throws as above, and without a surface.
[[nodiscard]] ProjectionResult project_objects(const maps::PointCloud& cloud,
                                               const GroundResult& ground,
                                               const std::vector<maps::Box>& boxes,
                                               const ProjectionOptions& options);

}  // namespace stillmap::mapping

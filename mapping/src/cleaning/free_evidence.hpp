#pragma once

#include "views/posed_views.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// A scan whose view is looked at.
struct Keyframe {
  std::size_t scan = 0;
  /// Number of the place it was taken at; what follows each other within 0.35 m is one place.
  std::uint32_t place = 0;
  /// What its word counts: less for the second and later ones of a place, whose rays go the same
  /// ways again.
  float weight = 1.0F;
};

/// One scan every 0.7 m or 10 degrees, and every 20 scans of a vehicle that stands: each place is
/// seen from enough places, and traffic that passes a standing vehicle is seen through too.
[[nodiscard]] std::vector<Keyframe> select_keyframes(
    std::span<const Eigen::Isometry3d> T_local_lidar);

/// What the views say about a cell.
struct FreeEvidence {
  /// How much speaks for it that the cell holds what moved, in [0, 1).
  float score = 0.0F;
  /// Weight of the views that hit it.
  float hits = 0.0F;
};

/// Asks the views whether cells hold what moved. The score is the weight of the longest run of
/// views, none of which hit it, that saw it free, against all views that say anything about it.
///
///     score = run / (kDoubt + free + hit + mixed)
///
/// and that over the passes that hit it, each 40 m of way and more after the last: what several of
/// them saw at one place stays.
///
/// What moved was there for a while and not before or after, so its free views follow each other,
/// however long it stood. What stays and is seen through now and then (a fence, a tree, a pole
/// between two rays) has its hits among them. A free view weighs 1 - 0.85^n for n rays around the
/// cell: the chance to meet something there that stops only 15 % of the rays. A run from a single
/// place counts nothing, unless all views that say anything about the cell are from there (a fixed
/// sensor) and the run is long.
/// @param positions  M points, local frame [m]. @param radius_m  of the cell around each.
/// @param keyframes  in the order of the scans.
/// @return M answers. Same input, same bits; each follows from its own position alone.
[[nodiscard]] std::vector<FreeEvidence> find_free_evidence(
    std::span<const Eigen::Vector3f> positions, float radius_m, const PosedViews& views,
    std::span<const Keyframe> keyframes);

/// Views farther from a cell are not asked [m].
inline constexpr float kViewReachM = 40.0F;

}  // namespace stillmap::mapping

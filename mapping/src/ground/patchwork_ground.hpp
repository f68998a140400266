#pragma once

#include "ground/ground_likelihood.hpp"
#include "ground/seed_plane.hpp"

#include <stillmap/mapping/ground.hpp>

#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Patchwork++ (concentric zones, reflected noise removal, region-wise vertical and ground plane
/// fitting, adaptive ground likelihood, revert) for proposals, then a height grid grown from them,
/// by which the points are labelled. What each part takes from the papers, and where it departs, is
/// said in its own header.
///
/// Why not the patches alone: at their borders and over kerbs, banks and bends one plane for 10 m
/// of ground is off by more than a kerb, and a beam or two of a sparse sensor make no plane at all
/// (mapping/measured.md has figures for both). A surface is needed in any case.
class PatchworkGround final : public GroundSegmenter {
 public:
  /// @throws std::invalid_argument for a height that is not > 0 and finite.
  explicit PatchworkGround(const GroundOptions& options);

  [[nodiscard]] GroundResult segment(const maps::PointCloud& cloud) const override;
  void learn(const maps::PointCloud& cloud) override;

 private:
  [[nodiscard]] std::optional<HeightPrior> given_prior() const;
  /// The height given, or else learned.
  [[nodiscard]] std::optional<HeightPrior> height_prior() const;

  std::optional<double> given_height_m_;
  /// Of the scans learned from.
  std::vector<double> found_heights_m_;
  GroundLikelihood likelihood_;
};

}  // namespace stillmap::mapping

#pragma once

#include "ground/cell_points.hpp"
#include "ground/ground_likelihood.hpp"
#include "ground/seed_plane.hpp"

#include <stillmap/mapping/ground.hpp>

#include <optional>
#include <vector>

namespace stillmap::mapping {


class PatchworkGround final : public GroundSegmenter {
 public:
  explicit PatchworkGround(const GroundOptions& options);

  [[nodiscard]] GroundResult segment(const maps::PointCloud& cloud) const override;
  void learn(const maps::PointCloud& cloud) override;

 private:
  [[nodiscard]] std::optional<HeightPrior> height_prior() const;

  std::optional<double> given_height_m_;
  std::vector<double> seen_heights_m_;
  GroundLikelihood likelihood_;
};

}  // namespace stillmap::mapping

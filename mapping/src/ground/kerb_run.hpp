#pragma once

#include "ground/ground_footprint.hpp"
#include "ground/step_fit.hpp"

#include <array>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// A kerb that was seen beside or under an object; local frame.
struct Kerb {
  /// On the kerb, next to the object's middle [m].
  Eigen::Vector2d foot = Eigen::Vector2d::Zero();
  Eigen::Vector2d normal = Eigen::Vector2d::UnitY();
  /// Of the side that the normal points to over the other [m].
  double rise = 0.0;
  /// How the ground rises on the side that the normal points from, and on the one it points to.
  std::array<Eigen::Vector2d, 2> slopes = {Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
};

/// What is known of the ground under one object: heights around it, in its footprint's own frame,
/// and what was fitted to them.
struct FittedFootprint {
  std::vector<HeightSample> samples;
  std::optional<SteppedPlane> planes;
};

/// The step of a fit, when both its sides are seen within half a metre of it: one whose place is
/// known, not one that was put beside the object because nothing told where it is.
[[nodiscard]] std::optional<Kerb> seen_kerb(const GroundFootprint& footprint,
                                            const FittedFootprint& fitted);

/// Lets kerbs go on to the next object: a fit without a step gets that of the nearest kerb whose
/// line, within 12 m, runs through the footprint, unless heights beyond that line speak against it.
/// In a row of parked cars the pavement behind one is often hidden while the kerb beside the last
/// one was seen. Three rounds, each from what the one before knew.
void continue_kerbs(std::span<const GroundFootprint> footprints,
                    std::vector<FittedFootprint>& fitted);

}  // namespace stillmap::mapping

#pragma once

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

/// Plants: trunk and branches, and leaves one by one, so that some rays get through. Foot at the
/// origin, z up.
namespace stillmap::simulation {

enum class TreeKind { kStreet, kLarge, kSlim, kConifer, kYoung };

/// @param foliage  share of the leaves that are there, in (0, 1]: leaves are taken away in a fixed
/// order, so that two days of one seed differ by single leaves only.
[[nodiscard]] Mesh make_tree(TreeKind kind, double foliage, Random random);
[[nodiscard]] Mesh make_bush(double foliage, Random random);
/// Tuft of high grass or flowers, 0.2 to 0.5 m.
[[nodiscard]] Mesh make_tuft(double foliage, Random random);

}  // namespace stillmap::simulation

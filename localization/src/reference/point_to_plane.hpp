#pragma once

#include "reference/terms.hpp"

namespace stillmap::localization {

/// Point-to-plane ICP (Chen, Medioni, 1992): Gauss-Newton on SE(3) over the distances along the
/// map's normals, for upright poles across both axes, with a Geman-McClure kernel that narrows from
/// 1 m to 0.2 m. Points whose neighbours in the map form no surface do not pull. Directions that
/// the points do not constrain stay where they are.
[[nodiscard]] const ReferenceMethod& point_to_plane();

}  // namespace stillmap::localization

#pragma once

#include "fusion/track.hpp"

#include <vector>

namespace stillmap::mapping {

/// Tracks of one drive that stood at the same place, joined: what was lost and found again.
/// @param tracks  none of them moved or given. @return in the order of their first box.
[[nodiscard]] std::vector<Track> joined_by_place(std::vector<Track> tracks);

}  // namespace stillmap::mapping

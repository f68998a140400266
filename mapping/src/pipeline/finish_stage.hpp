#pragma once

namespace stillmap::mapping {

struct Build;

/// Stage: cleans, fills and finishes all tiles, several at once, and writes them and the preview to
/// the package. Nothing is cleaned in regions that an edit keeps.
/// @throws maps::InputError when no point is left.
void finish_tiles(Build& build);

}  // namespace stillmap::mapping

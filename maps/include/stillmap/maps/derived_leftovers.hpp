#pragma once

#include <cstddef>
#include <filesystem>

namespace stillmap::maps {

/// Removes what killed writers of a `DerivedFile` left in a folder; what is being written right now
/// stays. Nothing happens where there is no such folder, and what cannot be removed stays too.
/// @return how many files went.
std::size_t clear_derived_leftovers(const std::filesystem::path& folder);

}  // namespace stillmap::maps

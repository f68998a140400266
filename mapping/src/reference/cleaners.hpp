#pragma once

#include <stillmap/mapping/cleaning.hpp>

#include <memory>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Names for `make_reference_cleaner`; none where STILLMAP_REFERENCE is off.
[[nodiscard]] std::vector<std::string> reference_cleaner_names();

/// A method of others with the settings of its paper.
/// @return nothing for a name that is not in `reference_cleaner_names`.
[[nodiscard]] std::unique_ptr<Cleaner> make_reference_cleaner(const std::string& name);

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/cleaning.hpp>
#include <stillmap/maps/map_package.hpp>

#include <memory>
#include <string>
#include <string_view>
#include <vector>

/// Methods of others to compare with: the library `stillmap_reference`. Where STILLMAP_REFERENCE is
/// off, it has none.
namespace stillmap::mapping {

/// Names for `make_reference_cleaner`.
[[nodiscard]] std::vector<std::string> reference_cleaner_names();

/// A method of others with the settings of its paper.
/// @return null for a name that is not in `reference_cleaner_names`.
[[nodiscard]] std::unique_ptr<Cleaner> make_reference_cleaner(const std::string& name);

/// Names for `make_map_aligner`: the product's own, the default first, then the references.
[[nodiscard]] std::vector<std::string> map_aligner_names();

/// An aligner for one map. @throws std::invalid_argument naming the method and the choices.
[[nodiscard]] std::unique_ptr<localization::Aligner> make_map_aligner(std::string_view method,
                                                                      const maps::MapPackage& map);

}  // namespace stillmap::mapping

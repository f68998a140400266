#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/map_package.hpp>

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Names for `make_map_aligner`: those of the product, the default first, then the references,
/// of which there are none where STILLMAP_REFERENCE is off.
[[nodiscard]] std::vector<std::string> map_aligner_names();

/// An aligner for one map. @throws std::invalid_argument naming the method and the choices.
[[nodiscard]] std::unique_ptr<localization::Aligner> make_map_aligner(std::string_view method,
                                                                      const maps::MapPackage& map);

}  // namespace stillmap::mapping

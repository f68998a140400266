#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/map_package.hpp>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Aligners of one map by method, the default first.
using Aligners = std::vector<std::pair<std::string, std::shared_ptr<const localization::Aligner>>>;
/// Makes a map ready for queries; may take seconds. The package outlives the aligners.
using AlignerBuilder =
    std::function<Aligners(const maps::MapPackage&, const localization::LocalizationOptions&)>;

/// Every method of `localization::aligner_names`: the default at once, each other made in the
/// background once it is asked for (`LazyAligner`).
/// @param options  of the default method.
[[nodiscard]] Aligners build_aligners(const maps::MapPackage& map,
                                      const localization::LocalizationOptions& options = {});

}  // namespace stillmap::server

#pragma once

#include "store/package_store.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

/// Checks and cleaning of a whole store, for an operator.

struct StoreProblem {
  /// Empty when it is of the store as a whole.
  std::string map, version;
  std::string what;
};
/// Recomputes all checksums and checks the state. Slow: reads everything.
[[nodiscard]] std::vector<StoreProblem> verify_store(const PackageStore& store);

/// "town/1, depot/1": those that hold a package.
[[nodiscard]] std::string versions_with(const StoreState& state, const std::string& digest);

struct ClearedPackages {
  /// Packages that no version names, by digest.
  std::vector<std::string> packages;
  /// Folders that a killed writer left.
  std::size_t leftovers = 0;
  /// Only where packages are elsewhere: how many of their files no package had.
  std::optional<std::size_t> blobs{};
};
/// Removes packages that no version names and what killed writers left. What is being written
/// right now stays.
ClearedPackages clear_unused(PackageStore& store);
/// The packages that `clear_unused` would remove, by digest.
[[nodiscard]] std::vector<std::string> unnamed_packages(const PackageStore& store);

}  // namespace stillmap::server

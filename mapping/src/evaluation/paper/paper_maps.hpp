#pragma once

#include <stillmap/mapping/map_build.hpp>

#include <string>
#include <vector>

namespace stillmap::mapping {

/// How one map of the table is made.
struct PaperMap {
  std::string name;
  /// For people.
  std::string title;
  /// All but detector and threads.
  MapBuildOptions build;
  /// Whether every point counts as measured.
  bool plain = false;
};

/// @param names  out of `paper_map_names`, empty = all; the table's order, whatever theirs.
/// @throws std::invalid_argument naming one that is not there, or that is there twice.
[[nodiscard]] std::vector<PaperMap> paper_maps(const std::vector<std::string>& names,
                                               const std::vector<std::string>& cleaners);

/// Every option of a build that makes its map another one, as text.
[[nodiscard]] std::string text_of(const MapBuildOptions& options);

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <vector>

namespace stillmap::maps {

/// The pose graph from which the poses of a map were estimated. Poses are numbered over all drives,
/// in the order of `MapPackage::trajectories`.
struct MapGraph {
  /// Ascending.
  std::vector<std::size_t> key_frames;
  /// Two poses that saw the same place.
  struct Loop {
    std::size_t from = 0, to = 0;
    /// Weight that the pose graph gave to it, in [0, 1].
    double weight = 1.0;
    auto operator<=>(const Loop&) const = default;
  };
  std::vector<Loop> loops;
};

/// Writes graph.json into the folder of a package that is being made. Same graph, same bytes.
/// @throws StorageError.
void write_map_graph(const std::filesystem::path& package, const MapGraph& graph);

/// @return nothing if the package has no graph: its poses were given, or an older program made it.
/// @throws InputError for a broken file, and for numbers that are none of the map's poses.
[[nodiscard]] std::optional<MapGraph> read_map_graph(const MapPackage& map);

/// Poses that would be key frames by the mapper's rule: a metre or 10 degrees from the one before,
/// and the first of each drive. For maps that do not say which they were.
[[nodiscard]] std::vector<std::size_t> derived_key_frames(const std::vector<Trajectory>& drives);

}  // namespace stillmap::maps

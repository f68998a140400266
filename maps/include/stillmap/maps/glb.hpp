#pragma once

#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <span>
#include <string>

namespace stillmap::maps {

/// Media type of a binary glTF.
inline constexpr const char* kGlbMediaType = "model/gltf-binary";

/// What stands in front of a tile's bytes to make a binary glTF 2.0 (GLB) of them: its header, its
/// JSON chunk and the head of its binary chunk. The points follow as they lie, 20 bytes each.
///
/// One mesh of points with the attributes POSITION (float x, y, z), _INTENSITY (float) and _POINT
/// (unsigned bytes: observations low and high, kind, object), interleaved. Positions count from the
/// tile's corner; the node's matrix puts that where it is relative to the map's origin. glTF is y
/// up: the matrix turns z to y, and what shows 3D Tiles turns it back.
///
/// @param tile  its number of points and their true bounds.
/// @throws std::invalid_argument for no points, or more than a GLB can hold (4 GiB).
/// @see glTF 2.0, 3.6 (accessors: offsets are multiples of the component, strides of 4) and 4
/// (GLB); 3D Tiles 1.1, "glTF transforms".
[[nodiscard]] std::string glb_head(const TileEntry& tile);

/// The whole file. @param points  as many as the tile says, from its corner.
[[nodiscard]] std::string glb_of(const TileEntry& tile, std::span<const MapPoint> points);

}  // namespace stillmap::maps

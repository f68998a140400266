#pragma once

#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/map_export.hpp>

#include <Eigen/Core>

#include <optional>

namespace stillmap::maps {

/// Takes the points of a map's tiles to the coordinates of an exported file.
class FileCoordinates {
 public:
  /// @throws InputError for kUtm and kMgrs where the map has no geodetic origin or lies in a polar
  /// region.
  FileCoordinates(const MapPackage& map, ExportFrame frame);

  /// @param point  of the tile.
  [[nodiscard]] Eigen::Vector3d operator()(const MapTile& tile, const MapPoint& point) const;

  [[nodiscard]] ExportFrame frame() const { return frame_; }
  /// With kUtm and kMgrs.
  [[nodiscard]] const std::optional<UtmProjection>& utm() const { return utm_; }

 private:
  ExportFrame frame_;
  /// Of kLocal, from the map's origin.
  Eigen::Vector3d local_ = Eigen::Vector3d::Zero();
  std::optional<UtmProjection> utm_;
};

/// Floats are 1 mm coarse below it [m], 2 mm from there on.
inline constexpr double kCoarseFromM = 16384.0;

/// @param origin  what is taken off the coordinates of the map frame.
/// @throws InputError naming the largest coordinate that is left, and what to do about it, when
/// 32-bit floats lose more than half a millimetre of it.
void require_fine_floats(const MapPackage& map, const Eigen::Vector3d& origin, const char* remedy);

/// "x y z" with as many digits as bring the doubles back.
[[nodiscard]] std::string exact_text(const Eigen::Vector3d& p);

/// Lines that say what a file's coordinates are, for the comments of its header.
[[nodiscard]] std::vector<std::string> frame_lines(const MapPackage& map,
                                                   const FileCoordinates& coordinates);

}  // namespace stillmap::maps

#pragma once

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/map_package.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// What the coordinates of an exported file are.
enum class ExportFrame {
  kMap,    ///< the map's own
  kLocal,  ///< the map's own, less `local_origin`
  kUtm,    ///< easting, northing [m] in the zone of the geodetic origin, height above the ellipsoid
  kMgrs,   ///< the same, less the corner of the MGRS square of 100 km that the map lies in
  /// Transverse Mercator of scale 0.9996 through the geodetic origin, its zero; height above the
  /// ellipsoid.
  kTransverseMercator,
};
[[nodiscard]] std::string_view name_of(ExportFrame frame);

/// Where kLocal counts from, in the map frame [m]: the `origin` of the manifest. Of a map that lies
/// so far from it that 32-bit floats are coarser than a millimetre it is a whole number of
/// kilometres from there, near the map's middle.
[[nodiscard]] Eigen::Vector3d local_origin(const MapPackage& map);

/// What is not set is the format's own choice; what a format has no use for must not be set.
struct MapExportOptions {
  /// Kinds of points that are left out, such as those that were projected.
  std::set<PointKind> without{};
  DerivedWork work{};
  std::optional<ExportFrame> frame{};
  /// PCD: a fifth field `kind` (`PointKind`, one byte).
  bool kinds = false;
  /// Edge of the cells of `nav2` and `octomap` [m], in [0.02, 5].
  std::optional<double> resolution_m{};
  /// `nav2`: what stands between these heights above the ground is an obstacle [m]; in [-5, 50],
  /// the second larger.
  std::optional<std::array<double, 2>> height_band_m{};
  /// `kitti`, `tum`: which trajectory; needed where a map has several.
  std::optional<std::size_t> drive{};

  /// Every broken bound as "name: value, bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// What was written.
struct MapExportResult {
  /// Of the map's own points; copies on coarser levels do not count.
  std::uint64_t points = 0;
  std::uint64_t files = 0;
  std::uint64_t bytes = 0;
  /// Of the points ground, projected, filled; left_out; cells, poses, leaves: what applies.
  std::map<std::string, std::uint64_t> counts;
  /// Added to the coordinates of the file [m] to get map coordinates; zero unless kLocal.
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  /// What a person should know: the projection used, intensities that were scaled, no trajectory.
  std::vector<std::string> notes;
};

/// Options that a format may have use for.
struct ExportUses {
  bool without = false, kinds = false, resolution = false, height_band = false, drive = false;
  /// The first one is its own choice.
  std::vector<ExportFrame> frames;
};

/// A format that maps are written in for other programs.
struct MapExportFormat {
  /// As people name it, such as `3dtiles`.
  std::string_view name;
  /// What comes out, in a line.
  std::string_view description;
  /// Whether a folder is written rather than a file.
  bool is_folder = false;
  ExportUses uses;
};
/// All that `export_map` writes, in the order in which they are listed.
[[nodiscard]] const std::vector<MapExportFormat>& map_export_formats();

/// @throws std::invalid_argument naming an option that is out of its bounds, or that the format has
/// no use for, or a frame that it cannot be written in.
void check_export_options(const MapExportFormat& format, const MapExportOptions& options);

/// Writes a map in another program's format, tile by tile; memory does not grow with the map but
/// for `nav2`, which holds one byte a cell. `target` appears whole or not at all. Same map, same
/// options, same bytes. Formats and their sources: maps/formats.md.
/// @throws std::invalid_argument for an unknown format and as `check_export_options`; InputError if
/// `target` exists or the map lacks what is asked for (trajectory, geodetic origin, a point), or
/// its coordinates do not fit into the format's 32-bit floats; StorageError; WorkStopped.
MapExportResult export_map(const MapPackage& map, std::string_view format,
                           const std::filesystem::path& target,
                           const MapExportOptions& options = {});

}  // namespace stillmap::maps

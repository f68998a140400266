#include "exports/file_coordinates.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <cmath>

#include "exports/exporters.hpp"

namespace stillmap::maps {
namespace {

/// Of a text of the package in a file's header [bytes].
constexpr std::size_t kMostOfLine = 128;

}  // namespace

FileCoordinates::FileCoordinates(const MapPackage& map, ExportFrame frame) : frame_(frame) {
  if (frame == ExportFrame::kLocal) local_ = local_origin(map) - map.manifest().origin;
  if (frame != ExportFrame::kUtm && frame != ExportFrame::kMgrs) return;
  const auto& place = map.manifest().geodetic_origin;
  const auto zone = place ? utm_zone_of(*place) : std::nullopt;
  if (!zone)
    throw InputError(map.folder().string(),
                     place ? fmt::format("a map at latitude {}", place->latitude_deg)
                           : "a map without a geodetic origin",
                     "one between 80 deg south and 84 deg north for UTM: give --coordinates map");
  utm_.emplace(*place, *zone);
}

Eigen::Vector3d FileCoordinates::operator()(const MapTile& tile, const MapPoint& point) const {
  if (frame_ == ExportFrame::kLocal) return tile.from_origin(point) - local_;
  return utm_ ? utm_->to_utm(tile.position(point)) : tile.position(point);
}

void require_fine_floats(const MapPackage& map, const Eigen::Vector3d& origin, const char* remedy) {
  double largest_m = 0.0;
  for (const TileEntry& tile : point_tiles(map)) {
    const Eigen::AlignedBox3d bounds = map.manifest().bounds_of(tile).translated(-origin);
    for (const Eigen::Vector3d& corner : {bounds.min(), bounds.max()})
      largest_m = std::max(largest_m, corner.cwiseAbs().maxCoeff());
  }
  if (largest_m < kCoarseFromM) return;
  const float at = static_cast<float>(largest_m);
  throw InputError(
      map.folder().string(),
      fmt::format(
          "coordinates up to {:.0f} m, where the format's 32-bit floats have steps of {:.2g} m",
          largest_m, std::nextafter(at, 2.0F * at) - at),
      remedy);
}

std::string exact_text(const Eigen::Vector3d& p) {
  return fmt::format("{} {} {}", p.x(), p.y(), p.z());
}

std::vector<std::string> frame_lines(const MapPackage& map, const FileCoordinates& coordinates) {
  const MapManifest& manifest = map.manifest();
  std::vector<std::string> lines{
      fmt::format("stillmap {} map {} frame {}", one_line(manifest.software_version, kMostOfLine),
                  map.digest().substr(0, 12), one_line(manifest.frame_id, kMostOfLine))};
  if (coordinates.frame() == ExportFrame::kLocal)
    lines.push_back("map coordinates = these + origin " + exact_text(local_origin(map)));
  if (const auto& utm = coordinates.utm())
    lines.push_back(
        fmt::format("coordinates EPSG:{}, height above the WGS 84 ellipsoid", utm->zone().epsg()));
  if (const auto taken = manifest.options.find("taken_as_wgs84"); taken != manifest.options.end())
    lines.push_back("taken as WGS 84: " + one_line(taken->second, kMostOfLine));
  if (const auto& place = manifest.geodetic_origin)
    lines.push_back(fmt::format("geodetic origin of the map WGS84 {} {} {}", place->latitude_deg,
                                place->longitude_deg, place->altitude_m));
  return lines;
}

}  // namespace stillmap::maps

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "exports/exporters.hpp"
#include "exports/file_coordinates.hpp"
#include "exports/output_file.hpp"
#include "exports/pcd_bytes.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr int kSizeM = 20;
/// Autoware's own, unless its file says another.
constexpr double kScale = 0.9996;
constexpr const char* kFolder = "pointcloud_map.pcd";
/// A file holds the points as floats, and belongs where these say.
using Square = std::pair<std::int64_t, std::int64_t>;

struct Written {
  Eigen::Vector3f p;
  float intensity;
};

/// Autoware's coordinates, whose heights are above the ellipsoid but for the map's own.
class AutowareCoordinates {
 public:
  explicit AutowareCoordinates(const ExportJob& job) : coordinates_(job.map, job.frame) {
    const auto& utm = coordinates_.utm();
    if (job.frame == ExportFrame::kTransverseMercator) {
      GeodeticOrigin zero = job.map.manifest().geodetic_origin.value();
      zero.altitude_m = 0.0;
      grid_.emplace(job.map.manifest().geodetic_origin.value(), grid_at(zero, kScale));
    } else if (job.frame == ExportFrame::kMgrs) {
      mgrs_ = square_around(job.map, *utm);
      origin_.head<2>() = mgrs_square(mgrs_).corner;
    } else if (utm) {
      origin_ = utm->to_utm(Eigen::Vector3d::Zero());
      origin_.z() = 0.0;
    }
  }
  [[nodiscard]] Eigen::Vector3f operator()(const MapTile& tile, const MapPoint& point) const {
    const Eigen::Vector3d p = coordinates_(tile, point);
    return (grid_ ? grid_->to_grid(p) : Eigen::Vector3d(p - origin_)).cast<float>();
  }
  /// Of kMgrs.
  [[nodiscard]] const std::string& mgrs() const { return mgrs_; }

 private:
  /// The only one that Autoware can use. @throws InputError where the map reaches into another.
  static std::string square_around(const MapPackage& map, const UtmProjection& utm) {
    // By their corners: one square has two names where a band of latitude ends in it.
    std::map<std::pair<double, double>, std::string> squares;
    for (const TileEntry& tile : point_tiles(map)) {
      const Eigen::AlignedBox3d bounds = map.manifest().bounds_of(tile);
      using Box = Eigen::AlignedBox3d;
      for (const auto which :
           {Box::BottomLeftFloor, Box::BottomRightFloor, Box::TopLeftFloor, Box::TopRightFloor}) {
        const Eigen::Vector3d p_map = bounds.corner(which);
        const std::string name = mgrs_name(utm.to_utm(p_map), utm.zone());
        const Eigen::Vector2d of_square = mgrs_square(name).corner;
        squares.try_emplace({of_square.x(), of_square.y()}, name);
      }
    }
    if (squares.size() == 1) return squares.begin()->second;
    std::vector<std::string> names;
    for (const auto& [corner, name] : squares) names.push_back(name);
    throw InputError(
        map.folder().string(),
        fmt::format("a map in {} squares of MGRS ({})", names.size(), fmt::join(names, ", ")),
        "one square, as Autoware needs it: give --coordinates utm");
  }

  FileCoordinates coordinates_;
  std::optional<GridProjection> grid_;
  std::string mgrs_;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
};

Square square_of(const Eigen::Vector3f& p) {
  const auto index = [](float value) {
    return static_cast<std::int64_t>(std::floor(static_cast<double>(value) / kSizeM));
  };
  return {index(p.x()), index(p.y())};
}

/// The squares that a tile's points fall into: tiles of the map need not lie on Autoware's grid,
/// whose corners are whole numbers.
std::map<Square, std::vector<TileId>> tiles_of_squares(const ExportJob& job,
                                                       const AutowareCoordinates& coordinates) {
  std::map<Square, std::vector<TileId>> squares;
  const std::vector<TileEntry> tiles = point_tiles(job.map);
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    std::set<Square> touched;
    const MapTile tile = job.map.tile(tiles[i].id);
    for (const MapPoint& point : tile)
      if (job.takes(point.kind)) touched.insert(square_of(coordinates(tile, point)));
    for (const Square& square : touched) squares[square].push_back(tiles[i].id);
    job.tell({0.2, 0.4}, i + 1, tiles.size());
  }
  return squares;
}

void write_square(const ExportJob& job, const AutowareCoordinates& coordinates,
                  const Square& square, const std::vector<TileId>& tiles, const fs::path& path) {
  std::vector<Written> points;
  for (const TileId& id : tiles) {
    const MapTile tile = job.map.tile(id);
    for (const MapPoint& point : tile) {
      if (!job.takes(point.kind)) continue;
      const Eigen::Vector3f p = coordinates(tile, point);
      if (square_of(p) == square) points.push_back({p, point.intensity});
    }
  }
  OutputFile file(path);
  file.write(pcd_header(points.size(), false, {}));
  for (const Written& point : points) put_pcd_point(file, point.p, point.intensity);
  file.close();
}

std::string projector_text(const ExportJob& job, const AutowareCoordinates& coordinates) {
  const auto& place = job.map.manifest().geodetic_origin;
  if (!place) return "projector_type: Local\n";
  if (job.frame == ExportFrame::kMgrs)
    return fmt::format("projector_type: MGRS\nvertical_datum: WGS84\nmgrs_grid: {}\n",
                       coordinates.mgrs());
  const bool is_map = job.frame == ExportFrame::kMap;
  const bool is_utm = job.frame == ExportFrame::kUtm;
  return fmt::format(
      "projector_type: {}\nvertical_datum: WGS84\nmap_origin:\n  latitude: {}\n  longitude: {}\n"
      "  altitude: {}\n{}",
      is_map   ? "LocalCartesian"
      : is_utm ? "LocalCartesianUTM"
               : "TransverseMercator",
      place->latitude_deg, place->longitude_deg, is_map ? place->altitude_m : 0.0,
      is_map || is_utm ? "" : fmt::format("scale_factor: {}\n", kScale));
}

void note_frame(ExportJob& job) {
  const auto& place = job.map.manifest().geodetic_origin;
  if (job.frame == ExportFrame::kMgrs)
    job.result.notes.emplace_back(
        "coordinates up to 100 km from the corner of the MGRS square are up to 8 mm coarse in "
        "Autoware's floats; with --coordinates utm they are fine");
  // Its loader takes the origin's altitude as 0, whatever the file says.
  if (!place || job.frame != ExportFrame::kMap) return;
  job.result.notes.push_back(
      fmt::format("Autoware takes altitudes as z, so those of GNSS are {} m above this map's; with "
                  "--coordinates utm they are the same",
                  place->altitude_m));
}

void write_text(const fs::path& path, std::string_view text) {
  OutputFile file(path);
  file.write(text);
  file.close();
}

}  // namespace

void export_autoware(ExportJob& job) {
  // Those of `LocalCartesianUTM` count from the same origin.
  require_fine_floats(job.map, job.result.origin,
                      "coordinates near zero, as Autoware's own maps have them: build the map from "
                      "poses near zero");
  count_chosen(job);
  const AutowareCoordinates coordinates(job);
  const auto squares = tiles_of_squares(job, coordinates);
  fs::create_directory(job.target / kFolder);
  std::string metadata = fmt::format("x_resolution: {0}\ny_resolution: {0}\n", kSizeM);
  std::size_t done = 0;
  for (const auto& [square, tiles] : squares) {
    const std::string name = fmt::format("{}_{}.pcd", square.first, square.second);
    write_square(job, coordinates, square, tiles, job.target / kFolder / name);
    // Autoware reads the corners as whole numbers.
    fmt::format_to(std::back_inserter(metadata), "{}: [{}, {}]\n", name, square.first * kSizeM,
                   square.second * kSizeM);
    job.tell({0.4, 1.0}, ++done, squares.size());
  }
  write_text(job.target / "pointcloud_map_metadata.yaml", metadata);
  write_text(job.target / "map_projector_info.yaml", projector_text(job, coordinates));
  job.result.counts["squares"] = squares.size();
  note_frame(job);
}

}  // namespace stillmap::maps

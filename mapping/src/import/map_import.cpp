#include "core/ordered_pipeline.hpp"
#include "core/top_view.hpp"
#include "import/column_ground.hpp"
#include "import/upright.hpp"
#include "stacking/tile_points.hpp"
#include "stacking/tile_stack.hpp"

#include <fmt/format.h>
#include <stillmap/mapping/map_import.hpp>
#include <stillmap/maps/autoware_map.hpp>
#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/peak_memory.hpp>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

using Clock = std::chrono::steady_clock;

/// As in a build.
constexpr std::size_t kMostVoxels = 5'000'000;
/// Floats are 2 mm coarse from here on, and 16 mm from there.
constexpr double kCoarseFromM = 16384.0;
constexpr double kTooCoarseFromM = 131072.0;
/// From there on "up" differs by 0.9 deg.
constexpr double kFarthestFromOriginM = 100'000.0;
/// What a column's ground may be off its points on a slope of 0.3.
constexpr float kGroundM = 0.15F;
/// Normals look up: nobody says from where the points were seen.
constexpr float kSeenFromM = 1e4F;

struct Bounds {
  Eigen::Vector3d min = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector3d max = -min;
};

/// Where a map from elsewhere stands.
struct ImportFrame {
  std::optional<maps::GeodeticOrigin> place;
  std::optional<maps::UtmZone> utm;
  /// With `utm`, and with the grids of Autoware.
  std::optional<maps::GridProjection> projection;
  /// As the file names them.
  std::string coordinates;
  /// What of `utm` is of other datums; empty for nothing.
  std::string taken_as_wgs84;
};

class CloudImport {
 public:
  CloudImport(const std::filesystem::path& file, const MapImportOptions& options,
              const ProgressCallback& progress, const CancelFlag& cancel, MapImportResult& result)
      : file_(file),
        R_map_file_(R_upright(options.up)),
        progress_(progress),
        cancel_(cancel),
        result_(result) {
    frame_.place = options.geodetic_origin;
    frame_.utm = options.utm;
    const bool is_autoware = maps::is_autoware_map(file);
    if (!is_autoware && !std::filesystem::is_directory(file)) {
      files_ = {file};
      return;
    }
    if (!is_autoware)
      throw maps::InputError(file.string(), "a folder without pointcloud_map.pcd",
                             "a file (.pcd, .ply, .las), or the folder of an Autoware map");
    autoware_ = maps::read_autoware_map(file);
    files_ = autoware_->clouds;
    result.warnings = autoware_->notes;
    if (options.utm)
      throw maps::InputError(file.string(), "an Autoware map with --utm",
                             "its map_projector_info.yaml alone: leave --utm out");
  }

  /// The first time through the file. @return the origin of the tiles [m].
  Eigen::Vector3d measure() {
    Bounds bounds;
    UprightCheck upright;
    const maps::CloudSummary summary = read("measure", [&](const maps::CloudPoint& point) {
      const Eigen::Vector3d p = R_map_file_ * point.position;
      bounds.min = bounds.min.cwiseMin(p);
      bounds.max = bounds.max.cwiseMax(p);
      upright.add(p);
    });
    if (std::string finding = upright.finding(); !finding.empty())
      result_.warnings.push_back(std::move(finding));
    points_ = summary.points_in_file;
    result_.counts["in"] = summary.points_in_file;
    result_.counts["dropped_non_finite"] = summary.non_finite;
    if (summary.withheld > 0) result_.counts["dropped_withheld"] = summary.withheld;
    if (summary.points_in_file == summary.non_finite + summary.withheld)
      throw maps::InputError(file_.string(), "no point that is finite", "at least one");
    if (summary.single_precision) check_precision(bounds);
    Eigen::Vector3d middle = map_origin_near(0.5 * (bounds.min + bounds.max));
    if (autoware_)
      find_frame_of_autoware(middle);
    else
      find_frame(summary, middle);
    if (!frame_.projection) return middle;
    if (!R_map_file_.isIdentity())
      throw maps::InputError(file_.string(), "coordinates in a grid, whose z is up, with --up",
                             "z: leave --up out");
    return map_origin_near(frame_.projection->to_map(middle));
  }

  /// Where the map stands, once it is measured.
  [[nodiscard]] const ImportFrame& frame() const { return frame_; }
  /// Of an Autoware map.
  [[nodiscard]] const std::optional<maps::AutowareMap>& autoware() const { return autoware_; }

  /// The second time.
  void stack(const VoxelGrid& grid, TileStack& stack) {
    std::uint64_t& too_far = result_.counts["dropped_too_far"];
    std::uint32_t part = 0;
    for (const std::filesystem::path& file : files_) {
      maps::read_cloud_file(file, [&](std::span<const maps::CloudPoint> points) {
        ScanVoxels voxels(grid, part++);
        for (const maps::CloudPoint& point : points)
          too_far += voxels.add({.p_map = p_map(point), .intensity = point.intensity}) ? 0 : 1;
        stack.add(voxels);
        tell("stack", points.size());
      });
    }
    done_ = 0;
    if (too_far > 0)
      result_.warnings.push_back(
          fmt::format("{} points are farther than the tile grid reaches", too_far));
  }

 private:
  template <typename Visit>
  maps::CloudSummary read(const char* stage, const Visit& visit) {
    maps::CloudSummary all;
    for (const std::filesystem::path& file : files_) {
      maps::CloudSummary summary =
          maps::read_cloud_file(file, [&](std::span<const maps::CloudPoint> points) {
            for (const maps::CloudPoint& point : points) visit(point);
            tell(stage, points.size());
          });
      summary.points_in_file += all.points_in_file;
      summary.non_finite += all.non_finite;
      summary.withheld += all.withheld;
      summary.single_precision = summary.single_precision || all.single_precision;
      all = std::move(summary);
    }
    done_ = 0;
    return all;
  }

  void tell(const char* stage, std::size_t points) {
    if (cancel_) throw Cancelled();
    done_ += points;
    // How many there are in all is known the second time.
    if (progress_) progress_(stage, done_, std::max<std::size_t>(done_, points_));
  }

  [[nodiscard]] Eigen::Vector3d p_map(const maps::CloudPoint& point) const {
    return frame_.projection ? frame_.projection->to_map(point.position)
                             : R_map_file_ * point.position;
  }

  /// What the file says of its coordinates, beside what the options say.
  void find_frame(const maps::CloudSummary& summary, const Eigen::Vector3d& middle) {
    frame_.coordinates = summary.coordinates;
    if (summary.utm && frame_.utm && *summary.utm != *frame_.utm)
      throw maps::InputError(
          file_.string(), summary.coordinates,
          fmt::format("EPSG:{}, as the options say: check --utm", frame_.utm->epsg()));
    if (!frame_.utm) frame_.utm = summary.utm;
    if (!frame_.utm) {
      if (!summary.coordinates.empty())
        result_.warnings.push_back(fmt::format(
            "coordinates of '{}', which is no UTM, are taken as they are", summary.coordinates));
      return;
    }
    const maps::GeodeticOrigin place =
        place_of([&] { return maps::geodetic_of(middle, *frame_.utm); },
                 "coordinates of this zone: check --utm");
    if (frame_.place)
      check_distance(*frame_.place, place);
    else
      frame_.place = place;
    frame_.projection.emplace(*frame_.place, maps::grid_of(*frame_.utm));
    const std::string coordinates = fmt::format("coordinates of '{}'", summary.coordinates);
    if (!summary.coordinates.empty() && !summary.utm)
      take_as_wgs84(coordinates, fmt::format("EPSG:{}, as the options say", frame_.utm->epsg()));
    else if (!is_wgs84(summary.coordinates))
      take_as_wgs84(coordinates, "those of WGS 84, which may be 2 m off");
    if (!summary.heights.empty())
      take_as_wgs84(fmt::format("heights of '{}'", summary.heights), "above the WGS 84 ellipsoid");
  }

  /// What Autoware's projector says of the coordinates. A map in a grid gets its frame at the place
  /// that the projector names, else in the middle of its points.
  void find_frame_of_autoware(const Eigen::Vector3d& middle) {
    const maps::AutowareMap& map = *autoware_;
    if (!map.heights.empty())
      take_as_wgs84(fmt::format("heights of '{}'", map.heights), "above the WGS 84 ellipsoid");
    if (!map.grid && map.origin && frame_.place) check_same_place(*map.origin, *frame_.place);
    if (!frame_.place) frame_.place = map.origin;
    if (!map.grid) return;
    const maps::GeodeticOrigin place =
        place_of([&] { return maps::place_in_grid(middle, *map.grid); },
                 "coordinates of its projector: check map_projector_info.yaml");
    if (frame_.place)
      check_distance(*frame_.place, place);
    else
      frame_.place = place;
    frame_.projection.emplace(*frame_.place, *map.grid);
  }

  /// Coordinates of LocalCartesian count from `map_origin`: another place would move the map. The
  /// altitude is not the file's to say.
  void check_same_place(const maps::GeodeticOrigin& of_file,
                        const maps::GeodeticOrigin& given) const {
    constexpr double kSameDeg = 1e-7;
    if (std::abs(of_file.latitude_deg - given.latitude_deg) <= kSameDeg &&
        std::abs(of_file.longitude_deg - given.longitude_deg) <= kSameDeg)
      return;
    throw maps::InputError(
        file_.string(),
        fmt::format("map_origin {}, {} of LocalCartesian, and --geo-origin {}, {}",
                    of_file.latitude_deg, of_file.longitude_deg, given.latitude_deg,
                    given.longitude_deg),
        "one place: leave --geo-origin out, or correct map_projector_info.yaml");
  }

  void take_as_wgs84(const std::string& what, const std::string& as) {
    result_.warnings.push_back(fmt::format("{} are taken as {}", what, as));
    frame_.taken_as_wgs84 += (frame_.taken_as_wgs84.empty() ? "" : ", ") + what;
  }

  /// A place and a zone that do not belong together would put the map far from its origin, tilted
  /// by the curve of the Earth and, beyond the grid, without its points.
  void check_distance(const maps::GeodeticOrigin& origin,
                      const maps::GeodeticOrigin& middle) const {
    const double distance_m = maps::T_enu_enu(origin, middle).translation().norm();
    if (distance_m <= kFarthestFromOriginM) return;
    throw maps::InputError(
        file_.string(),
        fmt::format("points around latitude {:.5f}, longitude {:.5f}, {:.0f} km from the geodetic "
                    "origin {:.5f}, {:.5f}",
                    middle.latitude_deg, middle.longitude_deg, distance_m / 1000.0,
                    origin.latitude_deg, origin.longitude_deg),
        fmt::format(
            "an origin within {:.0f} km, and the zone of the points: check --geo-origin and --utm",
            kFarthestFromOriginM / 1000.0));
  }

  /// Of a zone of UTM, by its name or code; without either, the options say it.
  static bool is_wgs84(std::string name) {
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) {
      return c == '_' ? ' ' : static_cast<char>(std::tolower(c));
    });
    return name.empty() || name.starts_with("wgs 84") || name.starts_with("wgs 1984") ||
           name.starts_with("epsg:326") || name.starts_with("epsg:327");
  }

  template <typename Find>
  [[nodiscard]] maps::GeodeticOrigin place_of(const Find& find, const char* remedy) const {
    try {
      return find();
    } catch (const std::invalid_argument& error) {
      throw maps::InputError(file_.string(), error.what(), remedy);
    }
  }

  void check_precision(const Bounds& bounds) {
    const double largest_m =
        std::max(bounds.min.cwiseAbs().maxCoeff(), bounds.max.cwiseAbs().maxCoeff());
    if (!(largest_m >= kCoarseFromM)) return;
    const float at = static_cast<float>(largest_m);
    const float step_m = std::nextafter(at, std::numeric_limits<float>::infinity()) - at;
    const std::string found = fmt::format(
        "coordinates up to {:.0f} m in 32-bit floats, {:.3g} m coarse there", largest_m, step_m);
    if (largest_m >= kTooCoarseFromM)
      throw maps::InputError(file_.string(), found,
                             "finer ones: write doubles, or coordinates from an origin nearby");
    result_.warnings.push_back(found);
  }

  const std::filesystem::path& file_;
  Eigen::Matrix3d R_map_file_;
  std::vector<std::filesystem::path> files_;
  std::optional<maps::AutowareMap> autoware_;
  const ProgressCallback& progress_;
  const CancelFlag& cancel_;
  MapImportResult& result_;
  ImportFrame frame_;
  std::size_t points_ = 0;
  std::size_t done_ = 0;
};

std::vector<Eigen::Vector3f> means_of(const VoxelGrid& grid, maps::TileId id,
                                      const std::vector<VoxelSum>& sums) {
  std::vector<Eigen::Vector3f> means;
  means.reserve(sums.size());
  for (const VoxelSum& sum : sums) means.push_back(mean_of(grid, id, sum).cast<float>());
  return means;
}

TilePoints finished(const VoxelGrid& grid, maps::TileId id, std::vector<VoxelSum> sums,
                    const ColumnGround& ground) {
  for (VoxelSum& sum : sums) {
    const Eigen::Vector3f p = mean_of(grid, id, sum).cast<float>();
    const auto height_m = ground.at(p);
    if (height_m && std::abs(p.z() - *height_m) <= kGroundM) sum.ground = sum.observations;
    // Parts of a file are no scans.
    sum.first_scan = 0;
    sum.last_scan = 0;
  }
  return to_points(grid, id, sums,
                   [](std::uint32_t) { return Eigen::Vector3f(0.0F, 0.0F, kSeenFromM); });
}

/// An import on its way, from the points of a file to a map.
struct Import {
  const VoxelGrid& grid;
  TileStack& stack;
  const ColumnGround& ground;
  maps::MapPackageWriter& writer;
  MapImportResult& result;
};

void write_tiles(const Import& import, int threads, const ProgressCallback& progress,
                 const CancelFlag& cancel) {
  const std::vector<maps::TileId> ids = import.stack.tiles();
  TopView preview = TopView::of_tiles(ids);
  std::size_t done = 0;
  process_in_order(
      ids.size(), threads,
      [&](std::size_t i) {
        return finished(import.grid, ids[i], import.stack.take(ids[i]), import.ground);
      },
      [&](const TilePoints& tile) {
        const maps::MapTile placed = tile.placed(import.grid.origin());
        import.writer.add_tile(tile.id, placed, tile.history);
        import.result.counts["static"] += placed.size();
        for (const maps::MapPoint& p : placed) {
          preview.add_point(placed.from_origin(p));
          import.result.counts["ground"] += p.kind == maps::PointKind::kGround ? 1 : 0;
        }
        if (progress) progress("tiles", ++done, ids.size());
      },
      cancel);
  preview.write_png(import.writer.folder() / "preview.png");
}

ColumnGround ground_of(const VoxelGrid& grid, const TileStack& stack, const CancelFlag& cancel) {
  ColumnGround ground;
  for (const maps::TileId& id : stack.tiles()) {
    if (cancel) throw Cancelled();
    ground.add(id, means_of(grid, id, stack.read(id)));
  }
  ground.finish();
  return ground;
}

void write_places(const ColumnGround& ground, const Eigen::Vector3d& origin,
                  maps::MapPackageWriter& writer, MapImportResult& result) {
  std::vector<Eigen::Isometry3d> places = ground.places();
  for (Eigen::Isometry3d& place : places) place.pretranslate(origin);
  result.counts["places"] = places.size();
  if (places.empty())
    result.warnings.emplace_back("no free ground found: scans need a prior in this map");
  else
    writer.write_places(places);
}

/// Of a file, or of the names and digests of the files of a folder.
std::string sha256_of_clouds(const std::filesystem::path& file,
                             const std::optional<maps::AutowareMap>& autoware) {
  if (!autoware) return maps::sha256_of_file(file);
  std::string digests;
  for (const std::filesystem::path& cloud : autoware->clouds)
    digests += maps::sha256_of_file(cloud) + "  " + cloud.filename().string() + "\n";
  return maps::sha256_of(digests);
}

maps::MapManifest manifest_of(const std::filesystem::path& file, const MapImportOptions& options,
                              const CloudImport& cloud, const Eigen::Vector3d& origin,
                              const MapImportResult& result) {
  const ImportFrame& frame = cloud.frame();
  const std::optional<maps::AutowareMap>& autoware = cloud.autoware();
  maps::MapManifest manifest;
  manifest.frame_id = options.frame_id.value_or(frame.place ? "enu" : "local");
  manifest.origin = origin;
  manifest.geodetic_origin = frame.place;
  manifest.voxel_size_m = options.voxel_size_m;
  manifest.software_version = STILLMAP_VERSION;
  manifest.options = {{"import", autoware ? "autoware" : file.extension().string().substr(1)},
                      {"voxel_size_m", fmt::format("{}", options.voxel_size_m)}};
  if (options.up != "z") manifest.options["up"] = options.up;
  if (frame.utm) manifest.options["utm"] = fmt::format("EPSG:{}", frame.utm->epsg());
  if (autoware && !autoware->projector.empty())
    manifest.options["projector"] =
        autoware->projector + (autoware->place_text.empty() ? "" : " ") + autoware->place_text;
  if (!frame.coordinates.empty()) manifest.options["coordinates"] = frame.coordinates;
  if (!frame.taken_as_wgs84.empty()) manifest.options["taken_as_wgs84"] = frame.taken_as_wgs84;
  manifest.counts = result.counts;
  const bool has_name = !file.filename().empty();
  manifest.sources = {{"cloud", (has_name ? file : file.parent_path()).filename().string()},
                      {"cloud_sha256", sha256_of_clouds(file, autoware)}};
  return manifest;
}

}  // namespace

std::vector<std::string> MapImportOptions::violations() const {
  std::vector<std::string> broken;
  if (geodetic_origin) broken = maps::violations(*geodetic_origin);
  const std::string name = frame_id.value_or("local");
  const bool printable =
      std::all_of(name.begin(), name.end(), [](char c) { return c >= ' ' && c <= '~'; });
  if (name.empty() || name.size() > 64 || !printable)
    broken.emplace_back("frame_id: expected 1 to 64 printable ASCII characters");
  if (!is_axis(up))
    broken.push_back(fmt::format("up (--up): {}, expected x, -x, y, -y, z or -z", up));
  else if (up != "z" && utm)
    broken.push_back(
        fmt::format("up (--up): {} beside a UTM zone, whose z is up; leave one out", up));
  if (utm && !(utm->number >= 1 && utm->number <= 60))
    broken.push_back(fmt::format("utm (--utm): zone {}, expected in [1, 60]", utm->number));
  if (!(voxel_size_m >= 0.02 && voxel_size_m <= 2.0))
    broken.push_back(
        fmt::format("voxel_size_m (--voxel): {}, expected in [0.02, 2]", voxel_size_m));
  if (!(threads >= 0 && threads <= 256))
    broken.push_back(fmt::format("threads (--threads): {}, expected in [0, 256]", threads));
  return broken;
}

MapImportResult import_map(const std::filesystem::path& file, const std::filesystem::path& target,
                           const MapImportOptions& options, const ProgressCallback& progress,
                           const CancelFlag& cancel) {
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument("import options: " + broken.front());
  const Clock::time_point began = Clock::now();
  MapImportResult result;
  CloudImport cloud(file, options, progress, cancel, result);
  const VoxelGrid grid(cloud.measure(), options.voxel_size_m);
  maps::MapPackageWriter writer(target);
  const std::filesystem::path scratch = writer.folder() / "scratch";
  {
    TileStack stack(scratch, kMostVoxels);
    cloud.stack(grid, stack);
    if (stack.tiles().empty())
      throw maps::InputError(file.string(), "no point within 20,000 km of their middle",
                             "at least one");
    const ColumnGround ground = ground_of(grid, stack, cancel);
    write_tiles({grid, stack, ground, writer, result}, options.threads, progress, cancel);
    write_places(ground, grid.origin(), writer, result);
  }
  result.seconds = std::chrono::duration<double>(Clock::now() - began).count();
  result.peak_rss_mib = maps::peak_rss_mib();
  result.digest =
      writer.publish(manifest_of(file, options, cloud, grid.origin(), result), to_json(result));
  return result;
}

std::string to_json(const MapImportResult& result) {
  return nlohmann::json{{"counts", result.counts},
                        {"seconds", result.seconds},
                        {"peak_rss_mib", result.peak_rss_mib},
                        {"warnings", result.warnings},
                        {"digest", result.digest},
                        {"version", STILLMAP_VERSION}}
      .dump(2);
}

}  // namespace stillmap::mapping

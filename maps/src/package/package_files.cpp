#include <stillmap/maps/package_files.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/json_fields.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

namespace stillmap::maps {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 50U;
/// As far as tiles of 32 bits go [m].
constexpr double kFarthestTileM = 4.3e10;
constexpr double kMaxFloat = std::numeric_limits<float>::max();

json to_json(const TileEntry& tile) {
  return {{"level", tile.id.level}, {"x", tile.id.x},  {"y", tile.id.y},
          {"points", tile.points},  {"min", tile.min}, {"max", tile.max}};
}

json to_json(const GeodeticOrigin& origin) {
  return {{"latitude_deg", origin.latitude_deg},
          {"longitude_deg", origin.longitude_deg},
          {"altitude_m", origin.altitude_m}};
}

/// Bounds of points that are floats.
std::array<double, 3> corner_from(const JsonField& field) {
  std::array<double, 3> corner{};
  std::size_t i = 0;
  field.each([&](const JsonField& value) {
    if (i == corner.size()) field.refuse("three numbers");
    corner[i++] = static_cast<float>(value.number(-kMaxFloat, kMaxFloat));
  });
  if (i != corner.size()) field.refuse("three numbers");
  return corner;
}

TileEntry tile_from(const JsonField& field) {
  constexpr std::int64_t kMaxLevel = 30;
  constexpr std::int64_t kLow = std::numeric_limits<std::int32_t>::min();
  constexpr std::int64_t kHigh = std::numeric_limits<std::int32_t>::max();
  TileEntry tile;
  tile.id.level = static_cast<std::uint32_t>(field.at("level").integer(0, kMaxLevel));
  tile.id.x = static_cast<std::int32_t>(field.at("x").integer(kLow, kHigh));
  tile.id.y = static_cast<std::int32_t>(field.at("y").integer(kLow, kHigh));
  tile.points = field.at("points").count();
  if (tile.points == 0 || tile.points > kMaxBytes / sizeof(MapPoint)) {
    field.at("points").refuse("a count of points > 0");
  }
  tile.min = corner_from(field.at("min"));
  tile.max = corner_from(field.at("max"));
  return tile;
}

json to_json(const MapExtent& extent) {
  json fields{{"tiles", extent.tiles}, {"points", extent.points}, {"area_m2", extent.area_m2}};
  if (extent.from_origin.isEmpty()) return fields;
  const auto corner = [](const Eigen::Vector3d& p) { return json{p.x(), p.y(), p.z()}; };
  fields["min"] = corner(extent.from_origin.min());
  fields["max"] = corner(extent.from_origin.max());
  return fields;
}

MapExtent extent_from(const JsonField& field) {
  MapExtent extent;
  extent.tiles = field.at("tiles").count();
  extent.points = field.at("points").count();
  if (extent.points > kMaxBytes / sizeof(MapPoint)) field.at("points").refuse("fewer points");
  extent.area_m2 = field.at("area_m2").number(0.0, std::numeric_limits<double>::max());
  if (extent.tiles == 0) return extent;
  extent.from_origin = {field.at("min").vector3(), field.at("max").vector3()};
  for (const char* corner : {"min", "max"})
    if (!(field.at(corner).vector3().cwiseAbs().maxCoeff() <= kFarthestTileM))
      field.at(corner).refuse("coordinates of tiles");
  if (extent.from_origin.isEmpty()) field.at("max").refuse("not below min");
  return extent;
}

GeodeticOrigin geodetic_from(const JsonField& field) {
  return {field.at("latitude_deg").number(-90.0, 90.0),
          field.at("longitude_deg").number(-180.0, 180.0), field.at("altitude_m").number()};
}

json to_json(const Registration& registration) {
  return {{"previous_digest", registration.previous_digest},
          {"T_previous_map", transform_json(registration.T_previous_map)},
          {"T_map_poses", transform_json(registration.T_map_poses)},
          {"residual_m", registration.residual_m},
          {"residual_rad", registration.residual_rad},
          {"scans_used", registration.scans_used},
          {"scans_asked", registration.scans_asked}};
}

bool is_sha256(const std::string& text) {
  return text.size() == 64 && std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

Registration registration_from(const JsonField& field) {
  constexpr double kMost = std::numeric_limits<double>::max();
  Registration registration;
  registration.previous_digest = field.at("previous_digest").text();
  if (!is_sha256(registration.previous_digest))
    field.at("previous_digest").refuse("64 lower-case hex digits");
  registration.T_previous_map = field.at("T_previous_map").transform();
  registration.T_map_poses = field.at("T_map_poses").transform();
  registration.residual_m = field.at("residual_m").number(0.0, kMost);
  registration.residual_rad = field.at("residual_rad").number(0.0, kMost);
  registration.scans_used = field.at("scans_used").count();
  registration.scans_asked = field.at("scans_asked").count();
  return registration;
}

/// Relative, inside the package, spelled in the one way, and not one of the two files that the list
/// cannot hold. The system would end a path at a NUL, and so take another one than was checked.
bool is_listable(const std::string& path) {
  const std::filesystem::path parts(path);
  if (path.empty() || parts.is_absolute() || path == kManifestName || path == kBuildName ||
      path.find('\0') != std::string::npos || parts.lexically_normal().string() != path) {
    return false;
  }
  return std::none_of(parts.begin(), parts.end(),
                      [](const auto& part) { return part.empty() || part == "." || part == ".."; });
}

MapManifest::File file_from(const std::string& path, const JsonField& field) {
  if (!is_listable(path)) field.refuse("a path inside the package");
  MapManifest::File file;
  file.bytes = field.at("bytes").count();
  file.sha256 = field.at("sha256").text();
  if (!is_sha256(file.sha256)) field.at("sha256").refuse("64 lower-case hex digits");
  return file;
}

void check_tiles_are_listed(const MapManifest& manifest, const std::string& file) {
  std::vector<TileId> ids;
  for (const TileEntry& tile : manifest.tiles) {
    ids.push_back(tile.id);
    const std::string path = tile_path(tile.id);
    const auto listed = manifest.files.find(path);
    if (listed == manifest.files.end()) throw InputError(file, "no " + path, "every tile in files");
    if (listed->second.bytes != tile.points * sizeof(MapPoint)) {
      throw InputError(file, std::to_string(listed->second.bytes) + " bytes for " + path,
                       std::to_string(tile.points * sizeof(MapPoint)));
    }
  }
  std::sort(ids.begin(), ids.end());
  const auto twice = std::adjacent_find(ids.begin(), ids.end());
  if (twice != ids.end()) throw InputError(file, tile_path(*twice) + " twice", "each tile once");
}

/// `stem.ending` of the first drive, then `stem_2.ending`, `stem_3.ending`.
std::string path_of_drive(const char* stem, std::size_t drive, const char* ending) {
  const std::string number = drive == 0 ? "" : "_" + std::to_string(drive + 1);
  return stem + number + ending;
}

/// Their numbers over all drives have 32 bits.
std::vector<MapManifest::DriveCounts> drives_from(const JsonField& field) {
  std::vector<MapManifest::DriveCounts> drives;
  std::int64_t scans_left = std::numeric_limits<std::uint32_t>::max(), objects_left = scans_left;
  const auto take = [](const JsonField& count, std::int64_t& left) {
    const std::int64_t taken = count.integer(0, left);
    left -= taken;
    return static_cast<std::uint32_t>(taken);
  };
  field.each([&](const JsonField& drive) {
    drives.push_back(
        {take(drive.at("scans"), scans_left), take(drive.at("objects"), objects_left)});
  });
  return drives;
}

std::map<std::string, std::string> texts_from(const JsonField& field) {
  std::map<std::string, std::string> texts;
  field.each_member(
      [&](const std::string& key, const JsonField& value) { texts[key] = value.text(); });
  return texts;
}

void check_schema(const JsonField& root) {
  const std::int64_t schema =
      root.at("schema").integer(1, std::numeric_limits<std::int32_t>::max());
  if (schema > kPackageSchema) {
    root.at("schema").refuse("schema " + std::to_string(kPackageSchema) +
                             " or older: this package needs a newer stillmap");
  }
}

}  // namespace

std::string tile_path(TileId id) {
  return "tiles/" + std::to_string(id.level) + "_" + std::to_string(id.x) + "_" +
         std::to_string(id.y) + ".bin";
}

std::string history_path(TileId id) {
  return std::filesystem::path(tile_path(id)).replace_extension(".history").string();
}

std::string trajectory_path(std::size_t drive) {
  return path_of_drive("trajectory", drive, ".tum");
}

std::string objects_path(std::size_t drive) { return path_of_drive("objects", drive, ".json"); }

std::string fates_path(std::size_t drive) { return path_of_drive("fates", drive, ".bin"); }

std::string disagreement_path(std::size_t drive) {
  return path_of_drive("disagreement", drive, ".txt");
}

std::string manifest_text(const MapManifest& manifest) {
  json root{{"schema", manifest.schema},
            {"frame_id", manifest.frame_id},
            {"origin", {manifest.origin.x(), manifest.origin.y(), manifest.origin.z()}},
            {"voxel_size_m", manifest.voxel_size_m},
            {"relative_clock", manifest.relative_clock},
            {"software_version", manifest.software_version},
            {"options", manifest.options},
            {"counts", manifest.counts},
            {"sources", manifest.sources},
            {"files", json::object()}};
  if (manifest.geodetic_origin) root["geodetic_origin"] = to_json(*manifest.geodetic_origin);
  if (manifest.registration) root["registration"] = to_json(*manifest.registration);
  if (manifest.schema == 1) {
    root["tiles"] = json::array();
    for (const TileEntry& tile : manifest.tiles) root["tiles"].push_back(to_json(tile));
  } else {
    root["drives"] = json::array();
    for (const auto& drive : manifest.drives)
      root["drives"].push_back({{"scans", drive.scans}, {"objects", drive.objects}});
    root["extent"] = to_json(manifest.extent);
  }
  for (const auto& [path, file] : manifest.files) {
    root["files"][path] = {{"bytes", file.bytes}, {"sha256", file.sha256}};
  }
  // A drive's name need not be UTF-8; the manifest must be.
  return root.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

MapManifest parse_manifest(std::string_view text, const std::string& file) {
  const json document = parse_json(text, file);
  const JsonField root(document, file);
  check_schema(root);
  MapManifest manifest;
  manifest.schema = static_cast<int>(root.at("schema").integer(1, kPackageSchema));
  manifest.frame_id = root.at("frame_id").text();
  manifest.origin = root.at("origin").vector3();
  if (root.has("geodetic_origin")) {
    manifest.geodetic_origin = geodetic_from(root.at("geodetic_origin"));
  }
  if (root.has("registration")) manifest.registration = registration_from(root.at("registration"));
  manifest.voxel_size_m = root.at("voxel_size_m").number(0.0, 1e6);
  manifest.relative_clock = root.at("relative_clock").boolean();
  manifest.software_version = root.at("software_version").text();
  manifest.options = texts_from(root.at("options"));
  manifest.sources = texts_from(root.at("sources"));
  root.at("counts").each_member([&](const std::string& key, const JsonField& value) {
    manifest.counts[key] = value.count();
  });
  if (manifest.schema == 1) {
    root.at("tiles").each(
        [&](const JsonField& field) { manifest.tiles.push_back(tile_from(field)); });
    for (const TileEntry& tile : manifest.tiles) manifest.extent.add(tile);
  } else {
    manifest.extent = extent_from(root.at("extent"));
    manifest.drives = drives_from(root.at("drives"));
  }
  root.at("files").each_member([&](const std::string& path, const JsonField& field) {
    manifest.files[path] = file_from(path, field);
  });
  check_tiles_are_listed(manifest, file);
  return manifest;
}

}  // namespace stillmap::maps

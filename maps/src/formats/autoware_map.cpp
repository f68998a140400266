#include <stillmap/maps/autoware_map.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>
#include <string_view>
#include <system_error>

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr const char* kClouds = "pointcloud_map.pcd";
constexpr const char* kMetadata = "pointcloud_map_metadata.yaml";
constexpr const char* kProjector = "map_projector_info.yaml";
constexpr std::uintmax_t kMostYamlBytes = std::uintmax_t{64} << 20U;

std::string_view unquoted(std::string_view text) {
  constexpr std::string_view kCut = " \t\r\"'{}";
  const std::size_t begin = text.find_first_not_of(kCut);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kCut) + 1 - begin);
}

/// A line of YAML as these files have them: `key: value`, where values of an inner map are
/// indented.
struct YamlLine {
  std::string_view key, value;
  bool is_inner = false;
};

std::vector<YamlLine> yaml_lines(std::string_view text) {
  std::vector<YamlLine> lines;
  while (const auto line = take_line(text)) {
    // "# comment", but not "a#b".
    std::size_t end = line->starts_with('#') ? 0 : std::min(line->find(" #"), line->size());
    const std::string_view part = line->substr(0, end);
    const std::size_t sign = part.find(':');
    if (sign == std::string_view::npos) continue;
    lines.push_back({unquoted(part.substr(0, sign)), part.substr(sign + 1),
                     part.starts_with(' ') || part.starts_with('\t')});
  }
  return lines;
}

/// Names of the tiles: keys of the metadata that are files.
std::set<std::string> named_tiles(const fs::path& file) {
  const std::string text = read_text(file, kMostYamlBytes);
  std::set<std::string> names;
  for (const YamlLine& line : yaml_lines(text))
    if (!line.is_inner && line.key.ends_with(".pcd")) names.emplace(line.key);
  return names;
}

std::vector<fs::path> pcd_files(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    if (entry->path().extension() == ".pcd" && !entry->is_directory())
      files.push_back(entry->path());
  if (error) throw StorageError(folder.string(), error.message());
  std::sort(files.begin(), files.end());
  return files;
}

void find_clouds(const fs::path& root, AutowareMap& map) {
  const fs::path clouds = root / kClouds;
  if (fs::is_regular_file(clouds)) {
    map.clouds = {clouds};
    return;
  }
  const fs::path folder = fs::is_directory(clouds) ? clouds : root;
  map.clouds = pcd_files(folder);
  const fs::path metadata = root / kMetadata;
  if (fs::exists(metadata)) {
    std::set<std::string> names = named_tiles(metadata);
    const auto unnamed = std::remove_if(
        map.clouds.begin(), map.clouds.end(),
        [&](const auto& file) { return names.erase(file.filename().string()) == 0; });
    if (!names.empty())
      throw InputError(metadata.string(),
                       fmt::format("{} tiles that are not in {}, such as {}", names.size(),
                                   folder.string(), one_line(*names.begin())),
                       "all tiles that it names: copy them, or take their lines away");
    if (const auto count = map.clouds.end() - unnamed; count > 0)
      map.notes.push_back(
          fmt::format("{} files left out, which {} does not name", count, kMetadata));
    map.clouds.erase(unnamed, map.clouds.end());
  }
  if (map.clouds.empty())
    throw InputError(folder.string(), "no *.pcd",
                     "the tiles of a map: give the folder that has them");
}

/// What `map_projector_info.yaml` says.
class Projector {
 public:
  explicit Projector(const fs::path& file) : file_(file) {
    const std::string text = read_text(file, kMostYamlBytes);
    for (const YamlLine& line : yaml_lines(text)) add(line);
  }

  void put_into(AutowareMap& map) const {
    map.projector = value("projector_type");
    if (const auto datum = values_.find("vertical_datum");
        datum != values_.end() && datum->second != "WGS84")
      map.heights = one_line(datum->second);
    if (map.projector == "Local" || map.projector == "local") return;
    if (map.projector == "MGRS") return put_mgrs(map);
    const bool is_known = map.projector == "LocalCartesian" ||
                          map.projector == "LocalCartesianUTM" ||
                          map.projector == "TransverseMercator";
    if (!is_known)
      throw InputError(file_.string(), "projector_type " + maps::quoted(map.projector),
                       "Local, LocalCartesian, LocalCartesianUTM, MGRS or TransverseMercator: "
                       "correct the line");
    map.origin = origin(map);
    map.place_text = fmt::format("{} {}", map.origin->latitude_deg, map.origin->longitude_deg);
    if (map.projector == "LocalCartesian") return;
    const GeodeticOrigin& zero = *map.origin;
    if (map.projector == "TransverseMercator") {
      const double scale = values_.contains("scale_factor") ? number("scale_factor") : 0.9996;
      if (!(scale >= 0.9 && scale <= 1.1))
        throw InputError(file_.string(), fmt::format("scale_factor {}", scale),
                         "one in [0.9, 1.1]: correct the line");
      map.grid = grid_at(zero, scale);
      return;
    }
    const auto zone = utm_zone_of(zero);
    if (!zone)
      throw InputError(file_.string(), fmt::format("latitude {} in UTM", zero.latitude_deg),
                       "one between 80 deg south and 84 deg north: correct map_origin");
    map.grid = grid_of(*zone);
    const Eigen::Vector3d p_zero = UtmProjection(zero, *zone).to_utm(Eigen::Vector3d::Zero());
    map.grid->offset -= p_zero;
  }

 private:
  void add(const YamlLine& line) {
    if (unquoted(line.value).empty()) {
      parent_ = line.key;
      return;
    }
    // "map_origin: {latitude: 35.2, longitude: 137.1}".
    if (const std::size_t brace = line.value.find('{'); brace != std::string_view::npos) {
      std::string_view rest = line.value.substr(brace + 1);
      while (!rest.empty()) {
        const std::string_view pair = rest.substr(0, rest.find(','));
        rest.remove_prefix(std::min(pair.size() + 1, rest.size()));
        if (const std::size_t sign = pair.find(':'); sign != std::string_view::npos)
          set(std::string(line.key) + '.' + std::string(unquoted(pair.substr(0, sign))),
              pair.substr(sign + 1));
      }
      return;
    }
    set(line.is_inner ? parent_ + '.' + std::string(line.key) : std::string(line.key), line.value);
  }
  void set(const std::string& key, std::string_view value) {
    values_[key] = std::string(unquoted(value));
  }

  [[nodiscard]] const std::string& value(const std::string& key) const {
    const auto found = values_.find(key);
    if (found == values_.end())
      throw InputError(file_.string(), "no " + key, "a line " + key + ": VALUE: add it");
    return found->second;
  }
  [[nodiscard]] double number(const std::string& key) const {
    const auto parsed = parse_number(value(key));
    if (!parsed)
      throw InputError(file_.string(), key + " " + maps::quoted(value(key)),
                       "a number: correct the line");
    return *parsed;
  }
  [[nodiscard]] GeodeticOrigin origin(AutowareMap& map) const {
    const GeodeticOrigin origin{number("map_origin.latitude"), number("map_origin.longitude"), 0.0};
    const bool has_altitude = values_.contains("map_origin.altitude");
    if (const double written_m = has_altitude ? number("map_origin.altitude") : 0.0;
        written_m != 0.0)
      map.notes.push_back(
          fmt::format("map_origin.altitude {} is taken as 0, as Autoware takes it{}", written_m,
                      map.projector == "LocalCartesian"
                          ? fmt::format(": if heights count from it, give --geo-origin {},{},{}",
                                        origin.latitude_deg, origin.longitude_deg, written_m)
                          : ""));
    if (const auto broken = violations(origin); !broken.empty())
      throw InputError(file_.string(), "map_origin " + broken.front(),
                       "a place on the Earth: correct the lines");
    return origin;
  }

  void put_mgrs(AutowareMap& map) const {
    const std::string& name = value("mgrs_grid");
    try {
      const MgrsSquare square = mgrs_square(name);
      map.place_text = name;
      map.grid = grid_of(square.zone);
      map.grid->offset.head<2>() -= square.corner;
    } catch (const std::invalid_argument& error) {
      throw InputError(file_.string(), "mgrs_grid " + maps::quoted(name),
                       "zone, band and two letters of a square of 100 km, as 54SUE: correct the "
                       "line");
    }
  }

  const fs::path& file_;
  std::map<std::string, std::string> values_;
  std::string parent_;
};

/// Above the folder of the tiles, where that was given.
fs::path root_of(const fs::path& folder) {
  const fs::path given = folder.filename().empty() ? folder.parent_path() : folder;
  return given.filename() == kClouds ? fs::absolute(given).parent_path() : given;
}

}  // namespace

bool is_autoware_map(const fs::path& folder) {
  const fs::path root = root_of(folder);
  if (!fs::is_directory(folder))
    return folder.filename() == kClouds && fs::exists(folder) && fs::exists(root / kProjector);
  return fs::exists(root / kClouds) || fs::exists(root / kMetadata);
}

AutowareMap read_autoware_map(const fs::path& folder) {
  const fs::path root = root_of(folder);
  AutowareMap map;
  find_clouds(root, map);
  const fs::path projector = root / kProjector;
  if (fs::exists(projector))
    Projector(projector).put_into(map);
  else
    map.notes.push_back(fmt::format("no {}: coordinates are taken as local ones", kProjector));
  return map;
}

}  // namespace stillmap::maps

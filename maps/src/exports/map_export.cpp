#include <stillmap/maps/map_export.hpp>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

#include "exports/export_formats.hpp"

namespace stillmap::maps {
namespace {

struct Format {
  MapExportFormat described;
  MapExportReport (*write)(const MapPackage&, const std::filesystem::path&,
                           const MapExportOptions&);
};

constexpr std::array kFormats = {
    Format{{"3dtiles",
            "a folder: 3D Tiles 1.1 with glTF points, levels of detail, for CesiumJS "
            "and other viewers"},
           export_tiles3d},
};

}  // namespace

std::vector<MapExportFormat> map_export_formats() {
  std::vector<MapExportFormat> all;
  for (const Format& format : kFormats) all.push_back(format.described);
  return all;
}

MapExportReport export_map(const MapPackage& map, std::string_view format,
                           const std::filesystem::path& out, const MapExportOptions& options) {
  const auto found = std::find_if(kFormats.begin(), kFormats.end(), [&](const Format& each) {
    return each.described.name == format;
  });
  if (found != kFormats.end()) return found->write(map, out, options);
  std::string names;
  for (const Format& each : kFormats)
    names += (names.empty() ? "" : ", ") + std::string(each.described.name);
  throw std::invalid_argument("format: found '" + std::string(format) + "', expected " + names);
}

}  // namespace stillmap::maps

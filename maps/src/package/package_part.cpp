#include <stillmap/maps/package_part.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/mapped_file.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

#include "package/region_node.hpp"
#include "package/tile_packs.hpp"

namespace stillmap::maps {
namespace {

/// A source of a part's manifest, and an option of it.
constexpr const char* kPartOf = "part_of";
constexpr const char* kPartRegions = "part_regions";

std::string text_of(const std::set<RegionId>& regions) {
  std::string text;
  for (const RegionId region : regions)
    text += fmt::format("{}{}_{}", text.empty() ? "" : " ", region.x, region.y);
  return text;
}

}  // namespace

std::optional<PackagePart> part_in(const MapManifest& manifest) {
  const auto of = manifest.sources.find(kPartOf);
  const auto regions = manifest.options.find(kPartRegions);
  if (of == manifest.sources.end() || regions == manifest.options.end()) return std::nullopt;
  PackagePart part{.of = of->second, .regions = {}};
  std::istringstream words(regions->second);
  for (std::string word; words >> word;)
    if (const auto region = region_of_path("regions/" + word + ".node"))
      part.regions.insert(*region);
  return part;
}

std::set<RegionId> regions_around(const MapManifest& manifest, const Eigen::Vector2d& place_map_m,
                                  double radius_m) {
  const Eigen::Vector2d place = place_map_m - manifest.origin.head<2>();
  std::set<RegionId> regions;
  for (const auto& [path, file] : manifest.files) {
    const auto region = region_of_path(path);
    if (!region) continue;
    const Eigen::Vector2d low = kRegionSizeM * Eigen::Vector2d(region->x, region->y);
    const Eigen::Vector2d high = low + Eigen::Vector2d::Constant(kRegionSizeM);
    const Eigen::Vector2d nearest = place.cwiseMax(low).cwiseMin(high);
    if ((nearest - place).norm() <= radius_m) regions.insert(*region);
  }
  return regions;
}

std::map<std::string, MapManifest::File> files_but_packs(const MapManifest& whole,
                                                         const std::set<RegionId>& regions) {
  std::map<std::string, MapManifest::File> files = whole.files;
  std::erase_if(files, [&](const auto& each) {
    const auto region = region_of_path(each.first);
    return is_pack(each.first) || (region && !regions.contains(*region));
  });
  return files;
}

MapManifest manifest_of_part(const MapManifest& whole, const PackagePart& part,
                             const std::filesystem::path& folder) {
  MapManifest manifest = whole;
  manifest.files = files_but_packs(whole, part.regions);
  manifest.sources[kPartOf] = part.of;
  manifest.options[kPartRegions] = text_of(part.regions);
  manifest.extent = {};
  std::map<std::string, MapManifest::File> packs;
  for (const auto& [path, file] : manifest.files) {
    const auto region = region_of_path(path);
    if (!region) continue;
    const MappedFile node(folder / path);
    const RegionNode content = decode_region(node.bytes(), (folder / path).string());
    for (const Pack& pack : content.packs) {
      const auto listed = whole.files.find(pack_path(pack));
      if (listed == whole.files.end())
        throw InputError((folder / path).string(), "a pack " + hex_of(pack.sha256),
                         "one that manifest.json lists: copy or build the map again");
      packs.insert(*listed);
    }
    for (const RegionTile& tile : content.tiles) manifest.extent.add(entry_of(*region, tile));
  }
  manifest.files.merge(packs);
  return manifest;
}

}  // namespace stillmap::maps

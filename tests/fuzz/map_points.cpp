// The points of a map's tile, up to a hundred of 20 bytes, and what the server does with a map
// before it answers: its index.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <algorithm>

#include <stillmap/maps/package_files.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  constexpr std::size_t kMostPoints = 100;
  const std::size_t points = std::min(kMostPoints, size / sizeof(maps::MapPoint));
  if (points == 0) return 0;
  static const bool made = std::filesystem::create_directories(fuzz::folder().path() / "tiles");
  static_cast<void>(made);
  const std::string_view tile = fuzz::text_of(data, points * sizeof(maps::MapPoint));
  fuzz::put(maps::tile_path({}), tile);
  maps::MapManifest manifest;
  manifest.tiles = {{.id = {}, .points = points}};
  manifest.files[maps::tile_path({})] = {.bytes = tile.size(), .sha256 = std::string(64, '0')};
  fuzz::put(maps::kManifestName, maps::manifest_text(manifest));
  const auto package = maps::MapPackage::open(fuzz::folder().path());
  const auto index =
      fuzz::taken<maps::InputError>([&] { return localization::MapIndex::build(*package); });
  if (!index) return 0;
  fuzz::require((*index)->voxel_count() > 0, "an index holds something");
  fuzz::require((*index)->bounds().min().allFinite() && (*index)->bounds().max().allFinite(),
                "an index has finite bounds");
  (*index)->verify();
  return 0;
}

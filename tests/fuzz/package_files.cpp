// The files of a package behind a manifest that fits them: parts of the input, parted by the byte
// 0x1e: a tile's points, their history, trajectory, objects, fates.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cmath>

#include <stillmap/maps/package_files.hpp>

namespace {

using namespace stillmap;

constexpr char kSeparator = 0x1e;

void list(maps::MapManifest& manifest, const std::string& path, std::string_view content) {
  fuzz::put(path, content);
  manifest.files[path] = {.bytes = content.size(), .sha256 = std::string(64, '0')};
}

std::shared_ptr<const maps::MapPackage> package_of(std::string_view input) {
  static const bool made = std::filesystem::create_directories(fuzz::folder().path() / "tiles");
  static_cast<void>(made);
  maps::MapManifest manifest;
  const std::string_view tile = fuzz::take_until(input, kSeparator);
  const std::size_t points = std::max<std::size_t>(1, tile.size() / sizeof(maps::MapPoint));
  std::string whole(tile.substr(0, points * sizeof(maps::MapPoint)));
  whole.resize(points * sizeof(maps::MapPoint));
  manifest.tiles = {{.id = {}, .points = points}};
  list(manifest, maps::tile_path({}), whole);
  std::string history(fuzz::take_until(input, kSeparator));
  history.resize(points * sizeof(maps::PointHistory));
  list(manifest, maps::history_path({}), history);
  list(manifest, maps::trajectory_path(0), fuzz::take_until(input, kSeparator));
  list(manifest, maps::objects_path(0), fuzz::take_until(input, kSeparator));
  list(manifest, maps::fates_path(0), input);
  fuzz::put(maps::kManifestName, maps::manifest_text(manifest));
  return maps::MapPackage::open(fuzz::folder().path());
}

void require_bounds(const std::vector<maps::MapObject>& objects) {
  for (const maps::MapObject& object : objects) {
    fuzz::require(object.size_m.allFinite() && object.score >= 0.0 && object.score <= 1.0,
                  "finite sizes, scores in [0, 1]");
    fuzz::require(!object.placements.empty(), "an object stood somewhere");
    for (const auto& each : object.placements)
      fuzz::require(each.centre_map.allFinite() && std::isfinite(each.yaw_rad), "a finite place");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto package = package_of(fuzz::text_of(data, size));
  if (const auto drives = fuzz::taken<maps::InputError>([&] { return package->trajectories(); })) {
    for (const maps::StampedPose& pose : drives->at(0).poses())
      fuzz::require(pose.T_map_lidar.matrix().allFinite(), "poses are finite");
  }
  if (const auto objects = fuzz::taken<maps::InputError>([&] { return package->objects(); }))
    require_bounds(*objects);
  for (const std::size_t scan : {std::size_t{0}, std::size_t{1}, ~std::size_t{0}}) {
    const auto fates = fuzz::taken<maps::InputError>([&] { return package->fates(scan); });
    fuzz::require(!fates || fates->fates.size() == fates->objects.size(), "an object a fate");
  }
  return 0;
}

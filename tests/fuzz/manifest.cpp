// manifest.json of a package whose other files are whole.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <stillmap/maps/package_files.hpp>

namespace {

using namespace stillmap;

/// Two tiles, one with a history, a trajectory and no objects, as the seeds list them.
const std::filesystem::path& package_folder() {
  static const std::filesystem::path made = [] {
    std::filesystem::create_directories(fuzz::folder().path() / "tiles");
    fuzz::put("tiles/0_0_0.bin", std::string(2 * sizeof(maps::MapPoint), '\0'));
    fuzz::put("tiles/0_0_0.history", std::string(2 * sizeof(maps::PointHistory), '\0'));
    fuzz::put("tiles/0_-1_0.bin", std::string(sizeof(maps::MapPoint), '\0'));
    fuzz::put("trajectory.tum", "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n");
    fuzz::put("objects.json", "{\"objects\": []}\n");
    return fuzz::folder().path();
  }();
  return made;
}

void require_bounds(const maps::MapManifest& manifest) {
  fuzz::require(manifest.schema >= 1 && manifest.schema <= maps::kPackageSchema, "a known schema");
  fuzz::require(manifest.origin.allFinite(), "a finite origin");
  fuzz::require(manifest.voxel_size_m >= 0.0 && manifest.voxel_size_m <= 1e6, "a voxel size");
  for (const auto& [path, file] : manifest.files) {
    const std::filesystem::path parts(path);
    fuzz::require(parts.is_relative() && !path.empty() && path.find('\0') == std::string::npos &&
                      *parts.begin() != ".." && parts.lexically_normal() == parts &&
                      parts.lexically_normal().string() == path,
                  "paths stay inside, each has one spelling");
    fuzz::require(file.sha256.size() == 64, "a digest");
  }
  for (const maps::TileEntry& tile : manifest.tiles) {
    const auto listed = manifest.files.find(maps::tile_path(tile.id));
    fuzz::require(listed != manifest.files.end() && tile.points > 0 &&
                      listed->second.bytes == tile.points * sizeof(maps::MapPoint),
                  "tiles are listed with their size");
  }
}

/// Text of what was read reads back as itself; rotations, which go through a matrix, to rounding.
void require_canonical(const maps::MapManifest& manifest) {
  const std::string canonical = maps::manifest_text(manifest);
  maps::MapManifest again = maps::parse_manifest(canonical, "again");
  fuzz::require(again.registration.has_value() == manifest.registration.has_value(),
                "a registration stays");
  if (again.registration) {
    for (const auto pose :
         {&maps::Registration::T_previous_map, &maps::Registration::T_map_poses}) {
      fuzz::require(
          (((*again.registration).*pose).linear() - ((*manifest.registration).*pose).linear())
                  .cwiseAbs()
                  .maxCoeff() < 1e-12,
          "rotations read back");
      ((*again.registration).*pose).linear() = ((*manifest.registration).*pose).linear();
    }
  }
  fuzz::require(maps::manifest_text(again) == canonical, "canonical text reads back as itself");
}

/// @return something, for `taken`.
bool open_and_read() {
  const auto package = maps::MapPackage::open(package_folder());
  for (const maps::TileEntry& tile : package->tiles()) {
    fuzz::require(package->tile(tile.id).size() == tile.points, "a tile has its points");
    const std::size_t known = package->history(tile.id).size();
    fuzz::require(known == 0 || known == tile.points, "a history a point");
  }
  static_cast<void>(package->verify());
  static_cast<void>(package->trajectories());
  static_cast<void>(package->objects());
  static_cast<void>(package->fates(0));
  return true;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text = fuzz::text_of(data, size);
  const auto manifest =
      fuzz::taken<maps::InputError>([&] { return maps::parse_manifest(text, "fuzz"); });
  if (!manifest) return 0;
  require_bounds(*manifest);
  require_canonical(*manifest);
  static_cast<void>(package_folder());
  fuzz::put("manifest.json", text);
  // StorageError: a name that is too long for the disk.
  static_cast<void>(fuzz::taken<maps::InputError, maps::StorageError>(open_and_read));
  return 0;
}

#include "store/single_map_store.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include "store/map_name.hpp"
#include "store/store_state.hpp"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <system_error>

#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

fs::path folder_of_package(const fs::path& package) {
  std::error_code error;
  if (fs::is_regular_file(package, error))
    throw maps::InputError(package.string(), "a file",
                           "the folder of a map package; unpack an archive first: tar xf");
  fs::path path = fs::canonical(package, error);
  if (error)
    throw maps::InputError(package.string(), "nothing",
                           "the folder of a map package; make one: stillmap build DRIVE -o MAP");
  if (is_there(path / kStateName))
    throw maps::InputError(package.string(), "a store",
                           "a map package; serve a store with --store");
  return path;
}

fs::path new_store_folder() {
  std::string name = (fs::temp_directory_path() / "stillmap-serve-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) throw maps::StorageError(name, std::strerror(errno));
  return name;
}

void fill_store(const fs::path& folder, const fs::path& package, const std::string& map) {
  StoredVersion version{.name = SingleMapStore::kVersion, .digest = {}};
  const auto opened = maps::MapPackage::open(package);
  version.digest = opened->digest();
  for (const auto& [path, file] : opened->manifest().files) version.bytes += file.bytes;
  version.created_ns = now_ns();
  fs::create_directory(folder / kPackagesName);
  fs::create_directory_symlink(package, folder / kPackagesName / version.digest);
  StoreState state(folder / kStateName);
  state.add_version(map, version);
  state.signatures().add(map, version.digest, signatures_beside(package));
  state.activate(map, version.name);
}

}  // namespace

SingleMapStore::SingleMapStore(const fs::path& package)
    : package_(folder_of_package(package)),
      map_(map_name_of(package_.filename().string())),
      folder_(new_store_folder()) {
  try {
    fill_store(folder_, package_, map_);
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
    throw;
  }
}

SingleMapStore::~SingleMapStore() {
  // Does not follow the link.
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

}  // namespace stillmap::server

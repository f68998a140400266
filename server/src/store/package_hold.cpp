#include "store/package_hold.hpp"
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <string>
#include <system_error>

#include <stillmap/maps/package_files.hpp>
#include "store/durable_files.hpp"
#include "store/package_copy.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// Work for a large map; what does not come is made anew.
void hold_index(const fs::path& package, const fs::path& held) {
  std::error_code error;
  fs::create_directory(held / kIndexFolder, error);
  for (fs::directory_iterator at(package / kIndexFolder, error);
       !error && at != fs::directory_iterator(); at.increment(error)) {
    const std::string name = at->path().filename().string();
    std::error_code ignored;
    // One that is being written just now has a name with a dot.
    if (!name.starts_with("."))
      fs::create_hard_link(at->path(), held / kIndexFolder / name, ignored);
  }
}

}  // namespace

bool hold_package(const fs::path& package, const fs::path& folder) {
  if (!is_there(package / maps::kManifestName))
    throw maps::InputError(package.string(), "nothing", "a package of the store");
  const DurableFiles files(DiskCalls::real());
  const fs::path half = folder.string() + ".new";
  if (is_there(half)) files.remove_tree(half);
  files.make_folder(half);
  if (!link_package(package, half, files)) {
    files.remove_tree(half);
    return false;
  }
  hold_index(package, half);
  files.rename(half, folder);
  return true;
}

}  // namespace stillmap::server

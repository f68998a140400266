#include "mapper/map_index.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <malloc.h>

namespace stillmap::mapper {

std::string write_index(const std::filesystem::path& map) {
  // What the build needed goes back to the system first.
  ::malloc_trim(0);
  try {
    const auto index = localization::MapIndex::open(*maps::MapPackage::open(map));
    return index->file().empty() ? index->kept_in_memory_because() : index->file().string();
  } catch (const maps::InputError& error) {
    return std::string("none: ") + error.what();
  }
}

}  // namespace stillmap::mapper

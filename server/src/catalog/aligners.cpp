#include "catalog/aligners.hpp"

#include "catalog/lazy_aligner.hpp"

#include <spdlog/spdlog.h>

#include <filesystem>
#include <memory>

namespace stillmap::server {
namespace {

/// Of the process: what it makes is large, so it makes one thing at a time.
DerivedWorker& worker() {
  static DerivedWorker the_worker;
  return the_worker;
}

}  // namespace

Aligners build_aligners(const maps::MapPackage& map,
                        const localization::LocalizationOptions& options) {
  const std::shared_ptr<const localization::MapIndex> index = localization::MapIndex::open(map);
  if (!index->rebuilt_because().empty()) {
    spdlog::info("index of {} was built, since no usable one was there: {}", map.folder().string(),
                 index->rebuilt_because());
  }
  if (!index->kept_in_memory_because().empty()) {
    spdlog::warn("index of {} is kept in memory and will be built again: {}", map.folder().string(),
                 index->kept_in_memory_because());
  }
  Aligners aligners;
  for (const std::string& method : localization::aligner_names()) {
    if (aligners.empty()) {
      aligners.emplace_back(method, localization::make_aligner(method, index, {}, options));
    } else {
      // The package may be closed before it is done, or removed: then nobody asks any more.
      const auto make = [method, folder = map.folder()] {
        return localization::make_aligner(method, *maps::MapPackage::open(folder));
      };
      const std::string what = "method '" + method + "' for package " + map.digest();
      aligners.emplace_back(method, std::make_shared<const LazyAligner>(what, make, worker()));
    }
  }
  return aligners;
}

}  // namespace stillmap::server

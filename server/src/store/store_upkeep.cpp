#include "store/store_upkeep.hpp"

#include <algorithm>
#include <cstddef>
#include <map>
#include <utility>

namespace stillmap::server {

std::vector<StoreProblem> verify_store(const PackageStore& store) {
  const StoreState& state = store.state();
  std::vector<StoreProblem> problems;
  for (std::string& what : state.problems()) problems.push_back({{}, {}, std::move(what)});
  // Several versions may name one package; it is read once.
  std::map<std::string, std::string> found;
  PackageBlobs::Verified known;
  for (const StoredMap& map : state.maps()) {
    for (const StoredVersion& version : state.versions(map.name)) {
      if (!found.contains(version.digest))
        found[version.digest] = store.damage_of(version.digest, known);
      // It may have been removed while it was read.
      if (!found[version.digest].empty() && state.uses(version.digest))
        problems.push_back({map.name, version.name, found[version.digest]});
    }
  }
  return problems;
}

std::string versions_with(const StoreState& state, const std::string& digest) {
  std::string names;
  for (const StoredMap& map : state.maps())
    for (const StoredVersion& version : state.versions(map.name))
      if (version.digest == digest)
        names += (names.empty() ? "" : ", ") + map.name + "/" + version.name;
  return names;
}

ClearedPackages clear_unused(PackageStore& store) {
  const StoreLock lock = store.locked();
  ClearedPackages cleared;
  // A folder may need a block more for the name of what is on its way out.
  store.even_when_full([&] {
    store.clear_condemned();
    if (PackageBlobs* const blobs = store.blobs()) {
      const std::vector<std::string> unnamed = blobs->unnamed(store.state().files());
      // A few at a time: the lock may be lost meanwhile.
      constexpr std::ptrdiff_t kAtOnce = 100;
      for (auto begin = unnamed.begin(); begin != unnamed.end();) {
        const auto end = begin + std::min(kAtOnce, unnamed.end() - begin);
        store.state().require_current();
        blobs->remove_blobs({begin, end});
        begin = end;
      }
      cleared.blobs = cleared.blobs.value_or(0) + unnamed.size();
      return;
    }
    if (cleared.packages.empty()) cleared.packages = unnamed_packages(store);
    store.state().require_current();
    for (const std::string& digest : cleared.packages) store.packages().remove(digest);
    cleared.leftovers += store.packages().clear_leftovers();
    store.packages().sync();
  });
  return cleared;
}

std::vector<std::string> unnamed_packages(const PackageStore& store) {
  std::vector<std::string> unnamed = store.packages().digests();
  std::erase_if(unnamed, [&](const std::string& digest) { return store.state().uses(digest); });
  return unnamed;
}

}  // namespace stillmap::server

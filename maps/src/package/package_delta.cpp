#include <stillmap/maps/package_delta.hpp>

#include <set>

namespace stillmap::maps {

PackageDelta package_delta(const MapManifest& from, const MapManifest& to) {
  std::set<std::string> known;
  for (const auto& [path, file] : from.files) known.insert(file.sha256);
  PackageDelta delta;
  for (const auto& [path, file] : to.files) {
    delta.bytes += file.bytes;
    if (known.contains(file.sha256)) continue;
    delta.missing.emplace(path, file);
    delta.missing_bytes += file.bytes;
  }
  return delta;
}

}  // namespace stillmap::maps

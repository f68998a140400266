#pragma once

#include <stillmap/maps/map_package.hpp>

#include <cstdint>
#include <map>
#include <string>

namespace stillmap::maps {

/// What is missing of a version where another one lies already.
struct PackageDelta {
  /// Files whose bytes no file of the other version has, by path. manifest.json, which is always
  /// missing, is not among them.
  std::map<std::string, MapManifest::File> missing;
  std::uint64_t missing_bytes = 0;
  /// Of all files of the version.
  std::uint64_t bytes = 0;
};

/// @param from  of the version that is there. @param to  of the one that is wanted.
[[nodiscard]] PackageDelta package_delta(const MapManifest& from, const MapManifest& to);

}  // namespace stillmap::maps

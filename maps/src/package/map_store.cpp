#include <stillmap/maps/map_store.hpp>

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <exception>

#include "package/manifest_json.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

bool is_low_letter_or_digit(char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); }

std::vector<fs::path> sub_folders(const fs::path& folder) {
  std::error_code error;
  fs::directory_iterator entries(folder, error);
  if (error) throw StorageError(folder.string(), error.message());
  std::vector<fs::path> folders;
  for (; entries != fs::directory_iterator(); entries.increment(error)) {
    // A hidden folder is a build in progress or the store's own.
    const bool hidden = entries->path().filename().string().starts_with('.');
    std::error_code unreadable;
    // That of `PackageStore`, which is no map.
    const bool packages = entries->path().filename() == "packages" &&
                          !fs::exists(entries->path() / kManifestName, unreadable);
    if (!hidden && !packages && entries->is_directory(unreadable))
      folders.push_back(entries->path());
  }
  if (error) throw StorageError(folder.string(), error.message());
  std::sort(folders.begin(), folders.end());
  return folders;
}

}  // namespace

bool is_valid_map_name(std::string_view name) {
  constexpr std::size_t kLongest = 63;
  if (name.empty() || name.size() > kLongest || !is_low_letter_or_digit(name.front())) return false;
  return std::all_of(name.begin(), name.end(), [](char c) {
    return is_low_letter_or_digit(c) || c == '.' || c == '_' || c == '-';
  });
}

MapStore::MapStore(const fs::path& folder) {
  for (const fs::path& sub_folder : sub_folders(folder)) {
    const std::string name = sub_folder.filename().string();
    if (!is_valid_map_name(name)) {
      refused_.push_back(
          {name, "name: found \"" + name + "\", expected [a-z0-9][a-z0-9._-]{0,62}"});
      continue;
    }
    // One broken map must not keep the others from being served.
    try {
      maps_.emplace(name, MapPackage::open(sub_folder));
    } catch (const std::exception& error) {
      refused_.push_back({name, error.what()});
    }
  }
}

std::vector<std::string> MapStore::names() const {
  std::vector<std::string> names;
  for (const auto& [name, package] : maps_) names.push_back(name);
  return names;
}

std::shared_ptr<const MapPackage> MapStore::find(std::string_view name) const {
  const auto found = maps_.find(name);
  return found == maps_.end() ? nullptr : found->second;
}

}  // namespace stillmap::maps

#pragma once

#include <stillmap/maps/map_package.hpp>

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// Maps of one folder: every sub-folder with a valid name and a manifest.json is a map of that
/// name. Names come from the folder's listing; what a client sends is only looked up. Safe from
/// several threads.
class MapStore {
 public:
  /// Why a sub-folder is not served; hidden ones (builds in progress) are not listed.
  struct Refusal {
    std::string name;
    std::string reason;
  };

  /// @throws StorageError if the folder cannot be listed.
  explicit MapStore(const std::filesystem::path& folder);

  /// Map names, sorted.
  [[nodiscard]] std::vector<std::string> names() const;
  /// @return null when there is no such map.
  [[nodiscard]] std::shared_ptr<const MapPackage> find(std::string_view name) const;
  [[nodiscard]] const std::vector<Refusal>& refused() const { return refused_; }

 private:
  std::map<std::string, std::shared_ptr<const MapPackage>, std::less<>> maps_;
  std::vector<Refusal> refused_;
};

/// `[a-z0-9][a-z0-9._-]{0,62}`
[[nodiscard]] bool is_valid_map_name(std::string_view name);

}  // namespace stillmap::maps

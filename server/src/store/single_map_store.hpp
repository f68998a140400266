#pragma once

#include <filesystem>
#include <string>

namespace stillmap::server {

/// A store in a new temporary folder, with one map whose active version is a package that stays
/// where it is. Nothing is copied: the store holds a link to the package's folder, where derived
/// files (index, levels) are written as always. Only for reading; removed at the end.
class SingleMapStore {
 public:
  /// @throws InputError for a folder that is no map package, StorageError.
  explicit SingleMapStore(const std::filesystem::path& package);
  ~SingleMapStore();
  SingleMapStore(const SingleMapStore&) = delete;
  SingleMapStore& operator=(const SingleMapStore&) = delete;

  /// Of the store.
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  /// The package's absolute path.
  [[nodiscard]] const std::filesystem::path& package() const { return package_; }
  /// `map_name_of` the package's folder.
  [[nodiscard]] const std::string& map() const { return map_; }

  /// Of the only version.
  static constexpr const char* kVersion = "v1";

 private:
  std::filesystem::path package_;
  std::string map_;
  std::filesystem::path folder_;
};

}  // namespace stillmap::server

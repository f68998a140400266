#pragma once

#include "index/index_bytes.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/mapped_file.hpp>
#include <stillmap/maps/region.hpp>

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::localization {

/// The files of an index lie in the package's folder `index/`; their names tell format and options.
[[nodiscard]] std::filesystem::path root_file_of(const std::filesystem::path& package,
                                                 const MapIndexOptions& options);
[[nodiscard]] std::filesystem::path region_file_of(const std::filesystem::path& package,
                                                   const MapIndexOptions& options,
                                                   maps::RegionId region);

/// Writes the file beside and renames it. @throws maps::StorageError, also while another process
/// writes it.
void publish_file(const std::filesystem::path& file, const maps::SectionFile& sections);

/// The bytes that an index looks into: a mapped file, or memory of its own.
class IndexStorage {
 public:
  /// @throws maps::StorageError.
  explicit IndexStorage(const std::filesystem::path& file)
      : mapped_(std::make_unique<const maps::MappedFile>(file)), name_(file.string()) {}
  explicit IndexStorage(std::vector<CacheLine> lines)
      : owned_(std::move(lines)), name_("map index") {}

  [[nodiscard]] std::span<const std::byte> bytes() const {
    return mapped_ ? mapped_->bytes() : std::as_bytes(std::span(owned_));
  }
  /// For messages.
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  std::unique_ptr<const maps::MappedFile> mapped_;
  std::vector<CacheLine> owned_;
  std::string name_;
};

/// A region of an index that can be looked into.
struct OpenRegion {
  OpenRegion(IndexStorage bytes, const IndexKey& key)
      : storage(std::move(bytes)), view(region_view(storage.bytes(), key, storage.name())) {}

  IndexStorage storage;
  RegionView view;
};

/// The root of an index.
struct OpenRoot {
  OpenRoot(IndexStorage bytes, const IndexKey& key)
      : storage(std::move(bytes)), view(root_view(storage.bytes(), key, storage.name())) {}

  IndexStorage storage;
  RootView view;
};

}  // namespace stillmap::localization

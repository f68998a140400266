#pragma once

#include <stillmap/maps/scratch_file.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace stillmap::mapping {

/// Flags of the points of all scans, in a scratch file: memory holds 16 bytes a scan.
class FlagStore {
 public:
  /// @param folder  existing. @throws maps::StorageError naming the file, as all below.
  explicit FlagStore(const std::filesystem::path& folder) : file_(folder, "flags") {}

  /// Of the next scan. Not while another thread is in any other function.
  void append(const std::vector<bool>& flags);
  /// Safe from several threads. @throws std::out_of_range.
  [[nodiscard]] std::vector<bool> read(std::size_t scan) const;

 private:
  struct Place {
    std::uint64_t offset = 0;
    std::uint64_t flags = 0;
  };
  maps::ScratchFile file_;
  std::vector<Place> places_;
};

}  // namespace stillmap::mapping

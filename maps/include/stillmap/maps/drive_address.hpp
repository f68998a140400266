#pragma once

#include <filesystem>
#include <string>

namespace stillmap::maps {

/// A drive as people write it, `PLACE?WORDS`, in its two parts.
struct DriveAddress {
  /// A folder or a file.
  std::filesystem::path place;
  /// Without the `?`; empty if nothing is chosen.
  std::string words;
};

/// Splits at the last `?`, unless a file or folder has the whole text as its name.
[[nodiscard]] DriveAddress split_address(const std::filesystem::path& address);

}  // namespace stillmap::maps

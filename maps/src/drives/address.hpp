#pragma once

#include <filesystem>
#include <string>

namespace stillmap::maps {

/// Where a drive lies, and what is chosen of it behind the last `?`.
struct Address {
  std::filesystem::path place;
  /// `word=value` parted by `&`, without those below.
  std::string words;
  /// Of `sensor=NAME`; empty without it.
  std::string sensor;
  /// Of `columns=LETTERS`; empty without it.
  std::string columns;
  /// Of `points=map`, the frame of the points; empty without it.
  std::string points;
};

[[nodiscard]] Address address_of(const std::filesystem::path& root);

}  // namespace stillmap::maps

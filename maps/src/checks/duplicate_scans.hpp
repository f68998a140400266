#pragma once

#include <stillmap/maps/drive.hpp>

#include <cstddef>

namespace stillmap::maps {

struct DuplicateScans {
  std::size_t count = 0;
  std::size_t first = 0;
};

/// Scans whose file has the same bytes as the one before. Files of other sizes are not read, and of
/// equal ones no more than it takes. Scans that share a file are not compared.
/// @throws StorageError.
[[nodiscard]] DuplicateScans duplicate_scans(const Drive& drive);

}  // namespace stillmap::maps

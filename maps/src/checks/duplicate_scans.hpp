#pragma once

#include <stillmap/maps/drive.hpp>

#include <cstddef>

namespace stillmap::maps {

struct DuplicateScans {
  std::size_t count = 0;
  std::size_t first = 0;
  /// Scans that were compared with the one before.
  std::size_t looked_at = 0;
};

/// Scans whose file has the same bytes as the one before. Files of other sizes are not read, and of
/// equal ones no more than it takes. Of recordings up to 100 scans, spread over them, are compared,
/// by their points.
/// Those that cannot be read are passed over. @throws StorageError.
[[nodiscard]] DuplicateScans duplicate_scans(const Drive& drive);

}  // namespace stillmap::maps

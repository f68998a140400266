#pragma once

#include <stillmap/maps/error.hpp>

namespace stillmap::server {

/// The disk, or the part of it that this user may take, has no room left. What was under way is
/// given up, and may be tried again when there is room.
class DiskFull : public maps::StorageError {
 public:
  using maps::StorageError::StorageError;
};

}  // namespace stillmap::server

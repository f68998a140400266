#pragma once

#include "store/drive_table.hpp"

#include <string>

namespace stillmap::server {

/// "drive 3" or "upload 3", as refusals name it.
inline std::string described(const StoredDrive& drive) {
  return (drive.is_upload() ? "upload " : "drive ") + std::to_string(drive.id);
}

}  // namespace stillmap::server

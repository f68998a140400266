#pragma once

#include <stillmap/maps/store/drive_table.hpp>

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Bytes of a request to open a drive.
inline constexpr std::size_t kMostDriveJson = 4096;

/// Reads `name?`: at most 200 bytes without control characters; an empty text says nothing.
/// @return the name, or nothing. @throws ApiError with the path of what is wrong.
[[nodiscard]] std::string read_drive_json(std::string_view text);

/// A version that comes in parts.
struct UploadRequest {
  std::string version;
  std::string content_type;
};
/// @throws ApiError with the path of what is wrong.
[[nodiscard]] UploadRequest read_upload_json(std::string_view text);

[[nodiscard]] std::string part_json(const maps::DrivePart& part);
[[nodiscard]] std::string drive_json(const maps::StoredDrive& drive,
                                     const std::vector<maps::DrivePart>& parts);
[[nodiscard]] std::string upload_json(const maps::StoredDrive& upload,
                                      const std::vector<maps::DrivePart>& parts);
/// Without their parts.
[[nodiscard]] std::string drive_list_json(const std::vector<maps::StoredDrive>& drives);
[[nodiscard]] std::string upload_list_json(const std::vector<maps::StoredDrive>& uploads);

}  // namespace stillmap::server

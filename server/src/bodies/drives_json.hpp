#pragma once

#include "store/drive_table.hpp"

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

/// Reads `choice?` (`maps::check_recording_choice`); an empty text says nothing.
/// @return it, or nothing. @throws ApiError with the path of what is wrong.
[[nodiscard]] std::string read_choice_json(std::string_view text);

/// A version that comes in parts.
struct UploadRequest {
  std::string version;
  std::string content_type;
};
/// @throws ApiError with the path of what is wrong.
[[nodiscard]] UploadRequest read_upload_json(std::string_view text);

[[nodiscard]] std::string part_json(const DrivePart& part);
[[nodiscard]] std::string drive_json(const StoredDrive& drive, const std::vector<DrivePart>& parts);
[[nodiscard]] std::string upload_json(const StoredDrive& upload,
                                      const std::vector<DrivePart>& parts);
/// Without their parts.
[[nodiscard]] std::string drive_list_json(const std::vector<StoredDrive>& drives);
[[nodiscard]] std::string upload_list_json(const std::vector<StoredDrive>& uploads);

}  // namespace stillmap::server

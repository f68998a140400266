#pragma once

#include <stillmap/maps/cloud_file.hpp>

#include <cstddef>
#include <functional>
#include <span>
#include <string>

namespace stillmap::maps {

/// LAS 1.0 to 1.4, point formats 0 to 10, as `read_cloud_file`. Bytes of a point beyond its format
/// are skipped; withheld points and those classified as noise are left out and counted.
CloudSummary stream_las(std::span<const std::byte> bytes, const std::string& name,
                        const std::function<void(std::span<const CloudPoint>)>& take);

/// The part of it that lies in the file's first bytes. @throws InputError.
void check_las_header(std::span<const std::byte> head, const std::string& name);

}  // namespace stillmap::maps

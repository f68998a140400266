#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bags/message_reader.hpp"
#include "packets/velodyne_models.hpp"

namespace stillmap::maps {

/// How messages of a type become scans.
struct CloudType {
  /// @param lasers  of a Velodyne's calibration, or empty.
  DecodedScan (*decode)(MessageReader& reader, std::span<const VelodyneLaser> lasers);
  /// Columns of a message, for people.
  std::vector<std::string> (*fields)(MessageReader& reader);
};

/// @return null for messages that are no scans.
[[nodiscard]] const CloudType* cloud_type(std::string_view type);

}  // namespace stillmap::maps

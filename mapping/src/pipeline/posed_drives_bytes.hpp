#pragma once

#include "pipeline/poses_stage.hpp"

#include <stillmap/maps/drive.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Poses, origin and counts as they are, for the journal; the same machine reads them again.
[[nodiscard]] std::string to_bytes(const PosedDrives& posed);

/// @param drives  as they were opened: what the poses are of.
/// @throws std::invalid_argument where these are not the bytes of poses of such drives.
[[nodiscard]] PosedDrives posed_drives_from(std::string_view bytes,
                                            const std::vector<maps::Drive>& drives);

}  // namespace stillmap::mapping

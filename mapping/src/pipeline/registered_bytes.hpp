#pragma once

#include "pipeline/poses_stage.hpp"
#include "registration/build_frame.hpp"

#include <stillmap/maps/drive.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Drives whose poses were moved into the frame of a map, and what is taken over from it.
struct RegisteredPoses {
  PosedDrives posed;
  BuildFrame frame;
};

/// For the journal.
[[nodiscard]] std::string to_bytes(const PosedDrives& posed, const BuildFrame& frame);

/// @param drives  as they were opened. @throws std::invalid_argument for other bytes.
[[nodiscard]] RegisteredPoses registered_poses_from(std::string_view bytes,
                                                    const std::vector<maps::Drive>& drives);

}  // namespace stillmap::mapping

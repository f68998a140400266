#include "pipeline/registered_bytes.hpp"

#include "pipeline/posed_drives_bytes.hpp"
#include "pipeline/record_bytes.hpp"

#include <utility>

namespace stillmap::mapping {

// Taken apart by structured bindings: a field that is added stops these from compiling.

std::string to_bytes(const PosedDrives& posed, const BuildFrame& frame) {
  const auto& [frame_id, origin, registration] = frame;
  const auto& [previous_digest, T_previous_map, T_map_poses, residual_m, residual_rad, used,
               asked] = registration;
  std::string bytes;
  put_each(bytes, frame_id, origin, previous_digest, T_previous_map, T_map_poses, residual_m,
           residual_rad, used, asked);
  put(bytes, to_bytes(posed));
  return bytes;
}

RegisteredPoses registered_poses_from(std::string_view bytes,
                                      const std::vector<maps::Drive>& drives) {
  ByteReader reader(bytes, "registered poses");
  BuildFrame frame;
  std::string posed;
  {
    auto& [frame_id, origin, registration] = frame;
    auto& [previous_digest, T_previous_map, T_map_poses, residual_m, residual_rad, used, asked] =
        registration;
    get_each(reader, frame_id, origin, previous_digest, T_previous_map, T_map_poses, residual_m,
             residual_rad, used, asked);
  }
  get(reader, posed);
  reader.end();
  return {posed_drives_from(posed, drives), std::move(frame)};
}

}  // namespace stillmap::mapping

#pragma once

#include "pose_request.hpp"

#include <stillmap/localization/aligner.hpp>

#include <cstddef>
#include <string>

namespace stillmap::server {

/// What a pose request is answered with.
struct PoseAnswer {
  localization::AlignmentResult result{};
  PoseParameters parameters{};
  /// Points of the scan that were left out because they lie in boxes of movable objects.
  std::size_t movable_points = 0;
  std::string map_name;
  std::string map_version;
  std::string map_digest;
  std::string request_id;
  struct Timing {
    double decode_ms = 0.0;
    double align_ms = 0.0;
    /// From the complete request to the complete answer, waiting included.
    double total_ms = 0.0;
  } timing{};
};

}  // namespace stillmap::server

#pragma once

#include "pose/pose_request.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/tracker.hpp>

#include <cstddef>
#include <optional>
#include <string>

namespace stillmap::server {

/// What a pose request is answered with.
struct PoseAnswer {
  localization::AlignmentResult result{};
  PoseParameters parameters{};
  /// Points of the scan that were left out because they lie in boxes of movable objects.
  std::size_t movable_points = 0;
  /// Points that say that nothing came back: not finite, or 0, 0, 0.
  std::size_t no_returns = 0;
  std::string map_name;
  std::string map_version;
  std::string map_digest;
  std::string request_id;
  /// Label of the vehicle that asked; empty when none was told.
  std::string vehicle{};
  /// Whether the request named the version, so that no roll-out chose it.
  bool version_was_named = false;
  /// How far the stamp is ahead of the server's clock [s], when that is more than allowed.
  std::optional<double> clock_skew_s{};
  /// Of a session's scan: its id, and where the search started.
  std::string session{};
  localization::SearchedFrom searched_from = localization::SearchedFrom::kNowhere;
  /// Of a sealed session's scan: whether this server has gone on from its seal before, and the
  /// version that the vehicle would get now, where that is another one.
  bool is_replay = false;
  std::string other_version{};
  /// In a set: its name, which is empty for all maps with a place on the Earth; where the map lies
  /// in it; and the map in which the vehicle was followed until this scan, if that was another one.
  std::string set{};
  std::optional<Eigen::Isometry3d> T_set_map{};
  std::string handed_over_from{};
  struct Timing {
    /// For a worker.
    double wait_ms = 0.0;
    double decode_ms = 0.0;
    double align_ms = 0.0;
    /// From the complete request to the complete answer, waiting included.
    double total_ms = 0.0;
  } timing{};
};

}  // namespace stillmap::server

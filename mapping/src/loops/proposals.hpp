#pragma once

#include "loops/loop_finder.hpp"
#include "loops/odometry_path.hpp"
#include "loops/ring_keys.hpp"
#include "loops/scan_context.hpp"
#include "loops/submaps.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Way between two keyframes from which on they may be a loop, no neighbours [m].
inline constexpr double kLeastLoopWayM = 40.0;

/// A place that a keyframe may have come back to.
struct Proposal {
  std::size_t query = 0;
  /// An earlier keyframe.
  std::size_t place = 0;
  Eigen::Isometry3d T_place_query = Eigen::Isometry3d::Identity();
  /// How well that is known; none = so far as looks tell (some metres, some degrees).
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
};

/// Places that look alike, best first, no two of one place.
class ContextProposals {
 public:
  /// @param contexts  one a keyframe, turned upright by `R_level_lidar`; outlives this, as the path
  /// does.
  ContextProposals(const std::vector<ScanContext>& contexts, const OdometryPath& path);
  /// Safe from several threads.
  [[nodiscard]] std::vector<Proposal> of(std::size_t query) const;

 private:
  const std::vector<ScanContext>& contexts_;
  const OdometryPath& path_;
  RingKeys keys_;
};

/// Where an earlier part of the path is from a keyframe, as odometry and the loops found so far
/// tell.
class PathProposals {
 public:
  /// @param loops  believed ones, of any order. @param given  may be none. All outlive this.
  PathProposals(const OdometryPath& path, const Submaps& submaps, const std::vector<Loop>& loops,
                const std::optional<GivenPlaces>& given = {});

  /// The nearest place that the query may have come back to, through the loops next to it; else by
  /// given places, or by odometry alone, where that still tells something. Safe from several
  /// threads.
  [[nodiscard]] std::optional<Proposal> of(std::size_t query) const;

  /// Whether nothing known speaks against a query's having been taken within some metres of a
  /// keyframe.
  [[nodiscard]] bool plausible(std::size_t query, std::size_t place) const;

 private:
  [[nodiscard]] std::vector<const Loop*> loops_near(std::size_t query) const;
  [[nodiscard]] std::optional<Proposal> through(const Loop& loop, std::size_t query) const;
  [[nodiscard]] std::optional<Proposal> by_odometry(std::size_t query) const;
  [[nodiscard]] std::optional<Proposal> by_given(std::size_t query) const;
  /// Between two keyframes, by given places.
  [[nodiscard]] UncertainMotion given_motion(std::size_t from, std::size_t to) const;

  const OdometryPath& path_;
  const Submaps& submaps_;
  /// By `to`.
  std::vector<Loop> loops_;
  std::optional<GivenPlaces> given_;
};

}  // namespace stillmap::mapping

#pragma once

#include <stillmap/mapping/localization_evaluation.hpp>

#include <Eigen/Geometry>

#include <cstdint>

namespace stillmap::mapping {

/// A uniform number in [0, 1) for each place in a table; nothing is shared between places, so any
/// order and any number of threads draws the same. SplitMix64's finalizer (Steele, Lea, Flood,
/// OOPSLA 2014) over the key.
class CounterRandom {
 public:
  CounterRandom(std::uint64_t seed, std::uint64_t scan, std::uint64_t trial);
  [[nodiscard]] double uniform(std::uint64_t draw) const;
  [[nodiscard]] double sign(std::uint64_t draw) const { return uniform(draw) < 0.5 ? -1.0 : 1.0; }

 private:
  std::uint64_t key_;
};

/// The pose with the prior error of one trial.
[[nodiscard]] Eigen::Isometry3d with_prior_error(const Eigen::Isometry3d& T_map_lidar,
                                                 const PriorError& error,
                                                 const CounterRandom& random);

}  // namespace stillmap::mapping

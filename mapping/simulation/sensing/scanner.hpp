#pragma once

#include <Eigen/Geometry>

#include <cstdint>
#include <vector>

#include "sensing/ego_motion.hpp"
#include "sensing/ray_scene.hpp"
#include "sensing/sensor.hpp"
#include "sensing/simulated_scan.hpp"

namespace stillmap::simulation {

struct ScannerOptions {
  /// All random numbers of a scan follow from it, the scan's number and the ray's.
  std::uint64_t key = 0;
  /// Also finds out what lies behind objects, which takes time.
  bool behind = false;
  /// Lasers of another unit have other constant errors; 0 = of the usual one.
  std::uint64_t unit = 0;
  /// How much later each scan is taken [s].
  double phase_s = 0.0;
};

/// Takes scans: every ray at its own time, from where the sensor is then.
class Scanner {
 public:
  /// @param world, ego, sensor  must outlive it.
  Scanner(const World& world, const EgoMotion& ego, Sensor& sensor, const ScannerOptions& options);

  /// @note Rays are cast by the threads of the calling TBB arena; the result does not depend on
  /// them.
  [[nodiscard]] SimulatedScan take(std::size_t index);

  /// Rays cast so far.
  [[nodiscard]] std::size_t rays() const { return rays_; }

 private:
  void look_at_own_vehicle(const std::vector<Beam>& beams);

  const World& world_;
  const EgoMotion& ego_;
  Sensor& sensor_;
  std::uint64_t key_;
  bool behind_;
  double phase_s_;
  RayScene scene_;
  MeshScene own_vehicle_;
  /// Where each beam meets our own vehicle [m]; infinite where it does not.
  std::vector<float> own_range_m_;
  std::vector<double> ring_bias_m_;
  std::vector<double> ring_gain_;
  std::size_t rays_ = 0;
};

}  // namespace stillmap::simulation

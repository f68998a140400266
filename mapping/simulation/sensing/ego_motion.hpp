#pragma once

#include <Eigen/Geometry>

#include <optional>
#include <string>

#include "scenarios/world.hpp"

namespace stillmap::simulation {

/// What carries the sensor along our own motion.
enum class Carrier {
  /// A car that drives as traffic does; it rolls, pitches and heaves on its springs.
  kVehicle,
  /// The same at twice the speed over rough ground: hard braking and turning, bumps, swerving.
  kFast,
  /// A person who walks beside the lane and looks around with the sensor in the hand.
  kHand,
};
/// "vehicle fast hand".
[[nodiscard]] std::string carrier_names();
[[nodiscard]] std::optional<Carrier> carrier_named(const std::string& name);
/// Time that passes for our own motion while a second passes for all else.
[[nodiscard]] double pace_of(Carrier carrier);

/// Where the sensor is, on what carries it.
class EgoMotion {
 public:
  /// @param world  must outlive it. @param lidar_height_m  over ground, of the usual place.
  /// @param T_usual_lidar  identity for a lidar in the usual place.
  EgoMotion(const World& world, double lidar_height_m, Carrier carrier = Carrier::kVehicle,
            const Eigen::Isometry3d& T_usual_lidar = Eigen::Isometry3d::Identity())
      : world_(world),
        height_m_(lidar_height_m),
        carrier_(carrier),
        T_usual_lidar_(T_usual_lidar) {}

  [[nodiscard]] const Eigen::Isometry3d& T_usual_lidar() const { return T_usual_lidar_; }

  /// At any time that our motion covers [s], divided by `pace_of`.
  [[nodiscard]] Eigen::Isometry3d T_world_lidar(double time_s) const;
  [[nodiscard]] Carrier carrier() const { return carrier_; }

 private:
  [[nodiscard]] Eigen::Isometry3d T_world_on_wheels(double time_s) const;
  [[nodiscard]] Eigen::Isometry3d T_world_in_hand(double time_s) const;

  const World& world_;
  double height_m_;
  Carrier carrier_;
  Eigen::Isometry3d T_usual_lidar_;
};

}  // namespace stillmap::simulation

#pragma once

#include <array>
#include <vector>

#include "bodies/bodies.hpp"
#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

/// What somebody looks like in any posture.
struct Figure {
  double height_m = 1.72;
  /// Against the usual thickness of limbs and torso.
  double girth = 1.0;
  Material top = Surface::kCloth;
  Material trousers = Surface::kCloth;
  Material shoes{Surface::kCloth, 0.4};
  bool helmet = false;
  bool backpack = false;
};

/// A posture, left before right: the middle between the hip joints, where ankles and wrists are
/// wanted [m]. Who cannot reach that far stretches arm or leg towards it.
struct Stance {
  Eigen::Vector3d hip;
  /// How far the torso leans forward.
  double lean_rad = 0.0;
  std::array<Eigen::Vector3d, 2> ankles;
  std::array<Eigen::Vector3d, 2> wrists;
  /// How far the toes point down.
  std::array<double, 2> toes_down_rad{0.0, 0.0};
  /// How far the left hip joint is ahead of the right one [m].
  double hip_turn_m = 0.0;
};

/// Shares of the height of a person at which joints lie.
/// @see Winter, "Biomechanics and Motor Control of Human Movement", 4th ed., fig. 4.1.
struct BodyShares {
  static constexpr double kHip = 0.530;
  static constexpr double kShoulder = 0.818;
  static constexpr double kAnkle = 0.039;
  static constexpr double kThigh = 0.245;
  static constexpr double kShank = 0.246;
  static constexpr double kUpperArm = 0.186;
  static constexpr double kForearm = 0.146;
  static constexpr double kShoulderHalfWidth = 0.118;
  static constexpr double kFoot = 0.152;
};

/// Middle between the shoulder joints.
[[nodiscard]] Eigen::Vector3d shoulders_of(const Figure& figure, const Stance& stance);

[[nodiscard]] Figure draw_figure(Random& random);
void add_person(Mesh& mesh, const Figure& figure, const Stance& stance);

/// Moves the first posture's footprint to the origin and the others as far, so that who begins to
/// walk does not jump; sets each down onto z = 0.
void settle_together(std::vector<Mesh>& postures);

/// Somebody on foot: standing, then eight phases of a stride.
[[nodiscard]] Body make_pedestrian(Random& random);

}  // namespace stillmap::simulation

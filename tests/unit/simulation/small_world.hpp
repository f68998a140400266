#pragma once

#include <memory>
#include <vector>

#include "scenarios/world.hpp"
#include "sensing/scanner.hpp"

/// A flat, straight street of 400 m along x, built by hand, with nothing on it but its ground.
namespace stillmap::simulation::small_world {

inline Motion straight_motion(double from_x, double y, double speed_mps, double duration_s) {
  Motion motion{.path = std::make_shared<Path>(std::vector<Eigen::Vector2d>{
                    {from_x, y}, {from_x + speed_mps * (duration_s + 4.0) + 4.0, y}}),
                .begin_s = -1.0,
                .stations_m = {},
                .offsets_m = {}};
  for (int i = 0; 0.1 * i <= duration_s + 2.0; ++i) {
    motion.stations_m.push_back(speed_mps * 0.1 * i + 1.0);
    motion.offsets_m.push_back(0.0);
  }
  return motion;
}

/// @param speed_mps  of our own vehicle, which is at x = 0 at time 0.
inline World flat_world(double speed_mps) {
  World world;
  world.network = std::make_shared<RoadNetwork>();
  RoadSection section;
  section.lane_width = 4.0;
  const std::size_t a = world.network->add_node({-200.0, 0.0});
  const std::size_t b = world.network->add_node({200.0, 0.0});
  world.network->add_edge(a, b, {0.0, 0.0}, section);
  world.network->finish();
  world.own_motion = straight_motion(-speed_mps - 1.0, 0.0, speed_mps, 3.0);
  world.terrain = std::make_unique<Terrain>(
      *world.network, Relief{.max_grade = 0.0, .hill_length_m = 200.0, .dip_m = 0.0}, 1,
      std::vector<Eigen::Vector2d>{{0.0, 0.0}}, 60.0);
  Mesh body;
  body.add_box(Eigen::Isometry3d::Identity(), {-2.0, -0.8, 0.3}, {2.0, 0.8, 0.9}, Surface::kPaint);
  world.own_body.postures = {body};
  return world;
}

/// Beams as given, measured without any error.
class ExactSensor : public Sensor {
 public:
  explicit ExactSensor(std::vector<Beam> beams) : beams_(std::move(beams)) {
    properties_.name = "exact";
    properties_.range_noise_m = 0.0;
    properties_.ring_bias_m = 0.0;
    properties_.divergence_rad = 0.0;
    properties_.range_step_m = 0.0;
    properties_.half_range_m = 1e6;
    properties_.rings = 1;
  }
  [[nodiscard]] const SensorProperties& properties() const override { return properties_; }
  [[nodiscard]] const std::vector<Beam>& beams(std::size_t /*scan*/) override { return beams_; }
  [[nodiscard]] SensorProperties& change() { return properties_; }

 private:
  SensorProperties properties_;
  std::vector<Beam> beams_;
};

}  // namespace stillmap::simulation::small_world

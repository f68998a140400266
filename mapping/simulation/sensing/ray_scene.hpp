#pragma once

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "scenarios/world.hpp"

namespace stillmap::simulation {

/// What a ray met.
struct Hit {
  double range_m = 0.0;
  /// Cosine of the angle between ray and surface normal, in [0, 1].
  double cos_incidence = 0.0;
  Material material{Surface::kWall};
  /// Index into World::actors; none for what cannot move.
  std::optional<std::size_t> actor;
  /// Number that all rays share that meet this pane or panel.
  std::uint64_t panel = 0;
};

/// A ray in the world's frame.
struct Ray {
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();
  /// Unit vector.
  Eigen::Vector3f direction = Eigen::Vector3f::UnitX();
  float min_range_m = 0.0F;
  float max_range_m = 0.0F;
  /// Between the two times that the actors were placed at, in [0, 1].
  float share = 0.0F;
};

/// First hits of a ray: on what stays, and on what can move and lies before that.
struct Hits {
  std::optional<Hit> fixed;
  std::optional<Hit> movable;
};

/// The world as Embree casts rays into it: one scene of all that stays, made once, and one of what
/// can move, made anew for every sweep. `cast` may be called from several threads,
/// `place_actors` not while it is.
class RayScene {
 public:
  static constexpr std::size_t kPacket = 8;

  /// @param world  must outlive the scene.
  explicit RayScene(const World& world);
  ~RayScene();
  RayScene(const RayScene&) = delete;
  RayScene& operator=(const RayScene&) = delete;

  /// Puts every actor that is nearer than `reach_m` to `centre` where it is from `begin_s` to
  /// `end_s`; between them it moves evenly.
  void place_actors(double begin_s, double end_s, const Eigen::Vector3d& centre, double reach_m);
  /// First hits of up to kPacket rays that are near each other.
  void cast(const Ray* rays, std::size_t count, Hits* hits) const;
  [[nodiscard]] Hits cast(const Ray& ray) const;

 private:
  struct Embree;
  const World& world_;
  std::unique_ptr<Embree> embree_;
};

/// Triangles of one mesh alone, for rays in its own frame.
class MeshScene {
 public:
  explicit MeshScene(const Mesh& mesh);
  ~MeshScene();
  MeshScene(const MeshScene&) = delete;
  MeshScene& operator=(const MeshScene&) = delete;
  [[nodiscard]] std::optional<Hit> cast(const Ray& ray) const;

 private:
  struct Embree;
  Mesh mesh_;
  std::unique_ptr<Embree> embree_;
};

}  // namespace stillmap::simulation

#include "sensing/ray_scene.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "sensing/embree_handles.hpp"

namespace stillmap::simulation {
namespace {

using embree::Device;
using embree::Geometry;
using embree::Scene;

}  // namespace

/// One copy of a mesh in the world.
struct MeshInstance {
  const Mesh* mesh = nullptr;
  std::optional<std::size_t> actor;
  /// Turns the mesh's normals to the world's frame, up to scale.
  Eigen::Matrix3f R_world_mesh = Eigen::Matrix3f::Identity();
};

namespace {

using Columns = Eigen::Matrix<float, 3, 4>;

Columns columns_of(const Eigen::Affine3d& T) { return T.matrix().topRows<3>().cast<float>(); }

RTCIntersectContext make_context(RTCIntersectContextFlags flags) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = flags;
  return context;
}

/// Which of the six sides of its body a normal in the body's frame looks from.
std::uint64_t side_of(const Eigen::Vector3f& normal) {
  Eigen::Index axis = 0;
  normal.cwiseAbs().maxCoeff(&axis);
  return static_cast<std::uint64_t>(2 * axis + (normal[axis] > 0.0F ? 1 : 0));
}

/// What Embree says of one ray, whether it was cast alone or in a packet.
struct Found {
  Eigen::Vector3f direction;
  /// In the frame of the mesh, of any length.
  Eigen::Vector3f normal;
  float range_m;
  unsigned geometry;
  unsigned instance;
  unsigned triangle;
};

Found found_in(const RTCRayHit8& p, std::size_t i) {
  return {{p.ray.dir_x[i], p.ray.dir_y[i], p.ray.dir_z[i]},
          {p.hit.Ng_x[i], p.hit.Ng_y[i], p.hit.Ng_z[i]},
          p.ray.tfar[i],
          p.hit.geomID[i],
          p.hit.instID[0][i],
          p.hit.primID[i]};
}

Found found_in(const RTCRayHit& p) {
  return {{p.ray.dir_x, p.ray.dir_y, p.ray.dir_z},
          {p.hit.Ng_x, p.hit.Ng_y, p.hit.Ng_z},
          p.ray.tfar,
          p.hit.geomID,
          p.hit.instID[0],
          p.hit.primID};
}

/// A body's sides are curved and of many triangles, so what lies on one side is one panel. Of what
/// stands, each quad is one: its two triangles follow each other.
std::uint64_t panel_of(const Found& found, const MeshInstance& instance) {
  if (instance.actor) return side_of(found.normal);
  return (static_cast<std::uint64_t>(found.instance) << 32U) | (found.triangle / 2);
}

std::optional<Hit> hit_from(const Found& found, const std::vector<MeshInstance>& instances) {
  if (found.geometry == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  const MeshInstance& instance = instances[found.instance];
  const Eigen::Vector3f normal = instance.R_world_mesh * found.normal;
  const double cosine = static_cast<double>(std::abs(normal.dot(found.direction)) / normal.norm());
  return Hit{.range_m = static_cast<double>(found.range_m),
             .cos_incidence = std::min(cosine, 1.0),
             .material = instance.mesh->materials[found.triangle],
             .actor = instance.actor,
             .panel = panel_of(found, instance)};
}

/// Objects beyond what stays do not matter.
float reach_of(const Ray& ray, const std::optional<Hit>& fixed) {
  return fixed ? static_cast<float>(fixed->range_m) : ray.max_range_m;
}

RTCRayHit query_of(const Ray& ray, float max_range_m) {
  RTCRayHit query{};
  query.ray.org_x = ray.origin.x();
  query.ray.org_y = ray.origin.y();
  query.ray.org_z = ray.origin.z();
  query.ray.dir_x = ray.direction.x();
  query.ray.dir_y = ray.direction.y();
  query.ray.dir_z = ray.direction.z();
  query.ray.tnear = ray.min_range_m;
  query.ray.tfar = max_range_m;
  query.ray.time = ray.share;
  query.ray.mask = 0xffffffffU;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return query;
}

void fill(RTCRayHit8& packet, const Ray* rays, std::size_t count) {
  for (std::size_t i = 0; i < RayScene::kPacket; ++i) {
    const Ray& ray = rays[std::min(i, count - 1)];
    packet.ray.org_x[i] = ray.origin.x();
    packet.ray.org_y[i] = ray.origin.y();
    packet.ray.org_z[i] = ray.origin.z();
    packet.ray.dir_x[i] = ray.direction.x();
    packet.ray.dir_y[i] = ray.direction.y();
    packet.ray.dir_z[i] = ray.direction.z();
    packet.ray.tnear[i] = ray.min_range_m;
    packet.ray.tfar[i] = ray.max_range_m;
    packet.ray.time[i] = ray.share;
    packet.ray.mask[i] = 0xffffffffU;
    packet.ray.id[i] = 0;
    packet.ray.flags[i] = 0;
    packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
}

}  // namespace

struct RayScene::Embree {
  Device device{embree::start_device()};
  Scene fixed{rtcNewScene(device.get())};
  std::vector<Scene> shapes;
  std::vector<MeshInstance> fixed_instances;
  /// A scene for each posture of each body.
  std::vector<std::vector<Scene>> bodies;
  std::optional<Scene> movable;
  std::vector<MeshInstance> movable_instances;

  void add_fixed(RTCScene shape, const Mesh& mesh, const Eigen::Affine3d& T_world_mesh) {
    const Geometry geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_INSTANCE));
    rtcSetGeometryInstancedScene(geometry.get(), shape);
    const Columns columns = columns_of(T_world_mesh);
    rtcSetGeometryTransform(geometry.get(), 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns.data());
    rtcCommitGeometry(geometry.get());
    // The number that a hit reports is the place in `fixed_instances`.
    rtcAttachGeometryByID(fixed.get(), geometry.get(),
                          static_cast<unsigned>(fixed_instances.size()));
    fixed_instances.push_back({&mesh, std::nullopt, columns.leftCols<3>()});
  }

  void add_movable(RTCScene body, const Mesh& mesh, std::size_t actor,
                   const std::array<Eigen::Isometry3d, 2>& T_world_body) {
    const Geometry geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_INSTANCE));
    rtcSetGeometryInstancedScene(geometry.get(), body);
    rtcSetGeometryTimeStepCount(geometry.get(), 2);
    for (unsigned i = 0; i < 2; ++i) {
      const Columns columns = columns_of(Eigen::Affine3d(T_world_body.at(i).matrix()));
      rtcSetGeometryTransform(geometry.get(), i, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns.data());
    }
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometryByID(movable->get(), geometry.get(),
                          static_cast<unsigned>(movable_instances.size()));
    movable_instances.push_back({&mesh, actor, T_world_body[0].linear().cast<float>()});
  }
};

RayScene::RayScene(const World& world) : world_(world), embree_(std::make_unique<Embree>()) {
  Embree& e = *embree_;
  rtcSetSceneFlags(e.fixed.get(), RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(e.fixed.get(), RTC_BUILD_QUALITY_HIGH);
  for (const Mesh& mesh : world.shapes) e.shapes.push_back(embree::scene_of(e.device.get(), mesh));
  for (const Mesh* mesh : {&world.ground, &world.buildings}) {
    e.shapes.push_back(embree::scene_of(e.device.get(), *mesh));
    e.add_fixed(e.shapes.back().get(), *mesh, Eigen::Affine3d::Identity());
  }
  for (const Placement& p : world.placements) {
    e.add_fixed(e.shapes.at(p.shape).get(), world.shapes.at(p.shape), p.T_world_shape);
  }
  rtcCommitScene(e.fixed.get());
  for (const Body& body : world.bodies) {
    e.bodies.emplace_back();
    for (const Mesh& mesh : body.postures) {
      e.bodies.back().push_back(embree::scene_of(e.device.get(), mesh));
    }
  }
  embree::check(e.device.get());
}

RayScene::~RayScene() = default;

void RayScene::place_actors(double begin_s, double end_s, const Eigen::Vector3d& centre,
                            double reach_m) {
  Embree& e = *embree_;
  e.movable.emplace(rtcNewScene(e.device.get()));
  e.movable_instances.clear();
  rtcSetSceneFlags(e.movable->get(), RTC_SCENE_FLAG_ROBUST);
  for (std::size_t i = 0; i < world_.actors.size(); ++i) {
    const Actor& actor = world_.actors[i];
    if (!actor.present(begin_s) || !actor.present(end_s)) continue;
    const Eigen::Isometry3d T = T_world_actor(world_, actor, begin_s);
    // The longest vehicle reaches 10 m beyond its middle.
    if ((T.translation() - centre).norm() > reach_m + 10.0) continue;
    const std::size_t posture = posture_of(world_, actor, 0.5 * (begin_s + end_s));
    e.add_movable(e.bodies[actor.body][posture].get(), world_.bodies[actor.body].postures[posture],
                  i, {T, actor.moves() ? T_world_actor(world_, actor, end_s) : T});
  }
  rtcCommitScene(e.movable->get());
  embree::check(e.device.get());
}

void RayScene::cast(const Ray* rays, std::size_t count, Hits* hits) const {
  alignas(32) std::array<int, kPacket> valid{};
  std::fill_n(valid.begin(), count, -1);
  RTCRayHit8 packet;
  fill(packet, rays, count);
  RTCIntersectContext context = make_context(RTC_INTERSECT_CONTEXT_FLAG_COHERENT);
  rtcIntersect8(valid.data(), embree_->fixed.get(), &context, &packet);
  for (std::size_t i = 0; i < count; ++i) {
    hits[i].fixed = hit_from(found_in(packet, i), embree_->fixed_instances);
    hits[i].movable.reset();
  }
  if (embree_->movable_instances.empty()) return;
  fill(packet, rays, count);
  for (std::size_t i = 0; i < count; ++i) packet.ray.tfar[i] = reach_of(rays[i], hits[i].fixed);
  rtcIntersect8(valid.data(), embree_->movable->get(), &context, &packet);
  for (std::size_t i = 0; i < count; ++i) {
    hits[i].movable = hit_from(found_in(packet, i), embree_->movable_instances);
  }
}

Hits RayScene::cast(const Ray& ray) const {
  Hits hits;
  RTCIntersectContext context = make_context(RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT);
  RTCRayHit query = query_of(ray, ray.max_range_m);
  rtcIntersect1(embree_->fixed.get(), &context, &query);
  hits.fixed = hit_from(found_in(query), embree_->fixed_instances);
  if (embree_->movable_instances.empty()) return hits;
  query = query_of(ray, reach_of(ray, hits.fixed));
  rtcIntersect1(embree_->movable->get(), &context, &query);
  hits.movable = hit_from(found_in(query), embree_->movable_instances);
  return hits;
}

struct MeshScene::Embree {
  Device device{embree::start_device()};
  Scene scene;
  explicit Embree(const Mesh& mesh) : scene(embree::scene_of(device.get(), mesh)) {}
};

MeshScene::MeshScene(const Mesh& mesh) : mesh_(mesh), embree_(std::make_unique<Embree>(mesh_)) {}
MeshScene::~MeshScene() = default;

std::optional<Hit> MeshScene::cast(const Ray& ray) const {
  RTCIntersectContext context = make_context(RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT);
  RTCRayHit query = query_of(ray, ray.max_range_m);
  rtcIntersect1(embree_->scene.get(), &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  const Eigen::Vector3f normal(query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z);
  const double cosine = static_cast<double>(std::abs(normal.normalized().dot(ray.direction)));
  return Hit{static_cast<double>(query.ray.tfar), std::min(cosine, 1.0),
             mesh_.materials[query.hit.primID], std::nullopt, query.hit.primID / 2};
}

}  // namespace stillmap::simulation

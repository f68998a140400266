#include "ray_scene.hpp"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::simulation {
namespace {

template <typename Handle, void (*Release)(Handle)>
class Owned {
 public:
  explicit Owned(Handle handle = nullptr) : handle_(handle) {}
  ~Owned() {
    if (handle_ != nullptr) Release(handle_);
  }
  Owned(Owned&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Owned& operator=(Owned&&) = delete;
  [[nodiscard]] Handle get() const { return handle_; }

 private:
  Handle handle_;
};
using Device = Owned<RTCDevice, rtcReleaseDevice>;
using Scene = Owned<RTCScene, rtcReleaseScene>;
using Geometry = Owned<RTCGeometry, rtcReleaseGeometry>;

void check(RTCDevice device) {
  const RTCError error = rtcGetDeviceError(device);
  if (error != RTC_ERROR_NONE) {
    throw std::runtime_error("Embree error " + std::to_string(static_cast<int>(error)));
  }
}

RTCDevice start_device() {
  RTCDevice device = rtcNewDevice(nullptr);
  if (device == nullptr) throw std::runtime_error("Embree cannot start");
  return device;
}

Scene scene_of(RTCDevice device, const Mesh& mesh) {
  const Geometry geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE));
  void* vertices =
      rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                              sizeof(Eigen::Vector3f), mesh.vertices.size());
  void* triangles =
      rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              sizeof(mesh.triangles[0]), mesh.triangles.size());
  if (vertices == nullptr || triangles == nullptr) throw std::bad_alloc();
  std::memcpy(vertices, mesh.vertices.data(), mesh.vertices.size() * sizeof(Eigen::Vector3f));
  std::memcpy(triangles, mesh.triangles.data(), mesh.triangles.size() * sizeof(mesh.triangles[0]));
  rtcCommitGeometry(geometry.get());
  Scene scene(rtcNewScene(device));
  // Without it a ray can slip through the edge that two triangles share.
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  rtcAttachGeometry(scene.get(), geometry.get());
  rtcCommitScene(scene.get());
  check(device);
  return scene;
}

/// One copy of a shape in the world.
struct Instance {
  Geometry geometry;
  const Mesh* mesh;
  std::optional<std::size_t> actor;
  /// Turns a shape's normals to the world's frame, up to scale.
  Eigen::Matrix3f R_world_shape = Eigen::Matrix3f::Identity();
};

}  // namespace

struct RayScene::Embree {
  Device device{start_device()};
  Scene top{rtcNewScene(device.get())};
  std::vector<Scene> shapes;
  std::vector<Instance> instances;

  void add_instance(RTCScene shape, const Mesh& mesh, std::optional<std::size_t> actor,
                    const Eigen::Affine3d& T_world_shape) {
    Geometry geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_INSTANCE));
    rtcSetGeometryInstancedScene(geometry.get(), shape);
    // The number that a hit reports is the place in `instances`.
    rtcAttachGeometryByID(top.get(), geometry.get(), static_cast<unsigned>(instances.size()));
    instances.push_back({std::move(geometry), &mesh, actor});
    place(instances.back(), T_world_shape);
  }

  static void place(Instance& instance, const Eigen::Affine3d& T_world_shape) {
    const Eigen::Matrix<float, 3, 4> columns = T_world_shape.matrix().topRows<3>().cast<float>();
    rtcSetGeometryTransform(instance.geometry.get(), 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR,
                            columns.data());
    rtcCommitGeometry(instance.geometry.get());
    instance.R_world_shape = columns.leftCols<3>();
  }
};

RayScene::RayScene(const World& world) : world_(world), embree_(std::make_unique<Embree>()) {
  Embree& e = *embree_;
  rtcSetSceneFlags(e.top.get(), RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_DYNAMIC);
  for (const Mesh& mesh : world.shapes) e.shapes.push_back(scene_of(e.device.get(), mesh));
  e.shapes.push_back(scene_of(e.device.get(), world.ground_and_buildings));
  e.add_instance(e.shapes.back().get(), world.ground_and_buildings, std::nullopt,
                 Eigen::Affine3d::Identity());
  for (const Placement& plant : world.plants) {
    e.add_instance(e.shapes.at(plant.shape).get(), world.shapes.at(plant.shape), std::nullopt,
                   plant.T_world_shape);
  }
  for (std::size_t i = 0; i < world.actors.size(); ++i) {
    const std::size_t shape = world.actors[i].shape;
    e.add_instance(e.shapes.at(shape).get(), world.shapes.at(shape), i,
                   Eigen::Affine3d::Identity());
  }
  set_time(0.0);
}

RayScene::~RayScene() = default;

void RayScene::set_time(double time_s) {
  for (Instance& instance : embree_->instances) {
    if (!instance.actor) continue;
    const Actor& actor = world_.actors[*instance.actor];
    if (time_s != 0.0 && !actor.moves()) continue;
    const double s = actor.s_at(time_s);
    // The street ends somewhere; what drives there is not to be seen before it has arrived.
    if (s < world_.road.begin_m() + 1.0 || s > world_.road.end_m() - 1.0) {
      rtcDisableGeometry(instance.geometry.get());
      continue;
    }
    rtcEnableGeometry(instance.geometry.get());
    Embree::place(instance, Eigen::Affine3d(T_world_actor(world_, actor, time_s).matrix()));
  }
  rtcCommitScene(embree_->top.get());
  check(embree_->device.get());
}

std::optional<Hit> RayScene::cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                  double min_range_m, double max_range_m) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{};
  query.ray.org_x = static_cast<float>(origin.x());
  query.ray.org_y = static_cast<float>(origin.y());
  query.ray.org_z = static_cast<float>(origin.z());
  query.ray.dir_x = static_cast<float>(direction.x());
  query.ray.dir_y = static_cast<float>(direction.y());
  query.ray.dir_z = static_cast<float>(direction.z());
  query.ray.tnear = static_cast<float>(min_range_m);
  query.ray.tfar = static_cast<float>(max_range_m);
  query.ray.mask = 0xffffffffU;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(embree_->top.get(), &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  const Instance& instance = embree_->instances[query.hit.instID[0]];
  const Eigen::Vector3f normal =
      instance.R_world_shape * Eigen::Vector3f(query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z);
  const double cos_incidence = std::abs(normal.normalized().cast<double>().dot(direction));
  return Hit{.range_m = static_cast<double>(query.ray.tfar),
             .cos_incidence = std::min(cos_incidence, 1.0),
             .surface = instance.mesh->surfaces[query.hit.primID],
             .actor = instance.actor};
}

}  // namespace stillmap::simulation

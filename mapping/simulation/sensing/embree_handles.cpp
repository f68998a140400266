#include "sensing/embree_handles.hpp"

#include <cstring>
#include <new>
#include <stdexcept>
#include <string>

namespace stillmap::simulation::embree {

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
  Scene scene(rtcNewScene(device));
  // Without it a ray can slip through the edge that two triangles share.
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  // Made once, asked for millions of rays.
  rtcSetSceneBuildQuality(scene.get(), RTC_BUILD_QUALITY_HIGH);
  if (!mesh.triangles.empty()) {
    const Geometry geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE));
    void* vertices =
        rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                sizeof(Eigen::Vector3f), mesh.vertices.size());
    void* triangles =
        rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                sizeof(mesh.triangles[0]), mesh.triangles.size());
    if (vertices == nullptr || triangles == nullptr) throw std::bad_alloc();
    // NOLINTNEXTLINE(bugprone-undefined-memory-manipulation): an Eigen vector is its three floats
    std::memcpy(vertices, mesh.vertices.data(), mesh.vertices.size() * sizeof(Eigen::Vector3f));
    std::memcpy(triangles, mesh.triangles.data(),
                mesh.triangles.size() * sizeof(mesh.triangles[0]));
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometry(scene.get(), geometry.get());
  }
  rtcCommitScene(scene.get());
  check(device);
  return scene;
}

}  // namespace stillmap::simulation::embree

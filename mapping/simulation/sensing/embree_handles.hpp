#pragma once

#include <embree3/rtcore.h>

#include <utility>

#include "geometry/mesh.hpp"

/// Embree's objects with owners. Included by ray_scene.cpp alone.
namespace stillmap::simulation::embree {

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

/// @throws std::runtime_error if Embree reports an error.
void check(RTCDevice device);
/// @throws std::runtime_error if Embree cannot start.
[[nodiscard]] RTCDevice start_device();
/// The mesh as a scene of its own, committed. @throws std::bad_alloc.
[[nodiscard]] Scene scene_of(RTCDevice device, const Mesh& mesh);

}  // namespace stillmap::simulation::embree

#include "output/tracking_labels.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string_view>

namespace stillmap::simulation {
namespace {

using Outline = Eigen::AlignedBox2d;

/// An object in the image.
struct Seen {
  const maps::Box* box = nullptr;
  Eigen::Vector3d centre_cam;
  /// Of all of it, also beyond the image's borders, and of what is within.
  Outline whole;
  Outline visible;
};

std::string_view type_of(maps::ObjectClass object_class) {
  switch (object_class) {
    case maps::ObjectClass::kCar:
      return "Car";
    case maps::ObjectClass::kVan:
      return "Van";
    case maps::ObjectClass::kTruck:
    case maps::ObjectClass::kBus:
      return "Truck";
    case maps::ObjectClass::kTram:
      return "Tram";
    case maps::ObjectClass::kCyclist:
      return "Cyclist";
    case maps::ObjectClass::kPedestrian:
      return "Pedestrian";
    case maps::ObjectClass::kTrailer:
    case maps::ObjectClass::kMotorcycle:
    case maps::ObjectClass::kUnknown:
      return "Misc";
  }
  return "Misc";
}

std::array<Eigen::Vector3d, 8> corners_in_camera(const maps::Box& box, const KittiCamera& camera) {
  const Eigen::AngleAxisd turned(box.yaw_rad, Eigen::Vector3d::UnitZ());
  std::array<Eigen::Vector3d, 8> corners;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector3d side((i & 1U) != 0 ? 0.5 : -0.5, (i & 2U) != 0 ? 0.5 : -0.5,
                               (i & 4U) != 0 ? 0.5 : -0.5);
    corners[i] = camera.T_cam_lidar * (box.centre + turned * side.cwiseProduct(box.size_m));
  }
  return corners;
}

/// Of the projected box; edges that pass the camera end at its side.
Outline outline_of(const maps::Box& box, const KittiCamera& camera) {
  // A little more than what `pixel_of` still takes.
  constexpr double kNearM = 0.11;
  const std::array<Eigen::Vector3d, 8> corners = corners_in_camera(box, camera);
  Outline outline;
  const auto extend = [&](const Eigen::Vector3d& p_cam) {
    if (const auto pixel = camera.pixel_of(p_cam)) outline.extend(*pixel);
  };
  for (std::size_t a = 0; a < corners.size(); ++a) {
    extend(corners[a]);
    for (std::size_t axis = 1; axis < corners.size(); axis *= 2) {
      const std::size_t b = a ^ axis;
      if (!(corners[a].z() < kNearM && corners[b].z() > kNearM)) continue;
      const double share = (kNearM - corners[a].z()) / (corners[b].z() - corners[a].z());
      extend(corners[a] + share * (corners[b] - corners[a]));
    }
  }
  return outline;
}

std::vector<Seen> seen_boxes(const std::vector<maps::Box>& boxes, const KittiCamera& camera) {
  const Outline image(Eigen::Vector2d::Zero(),
                      Eigen::Vector2d(kImageWidth - 1.0, kImageHeight - 1.0));
  std::vector<Seen> seen;
  for (const maps::Box& box : boxes) {
    const Eigen::Vector3d centre_cam = camera.T_cam_lidar * box.centre;
    const Outline whole = outline_of(box, camera);
    if (!(centre_cam.z() > 0.0) || whole.isEmpty()) continue;
    const Outline visible = whole.intersection(image);
    // Less than a pixel either way is nothing that a labeller would see.
    if (visible.isEmpty() || visible.sizes().minCoeff() < 1.0) continue;
    seen.push_back({&box, centre_cam, whole, visible});
  }
  return seen;
}

/// 0 none, 1 some, 2 most.
int level_of(double share) {
  constexpr double kSome = 0.1;
  constexpr double kMost = 0.5;
  return share < kSome ? 0 : share < kMost ? 1 : 2;
}

/// How much of what is visible of an object lies behind the outlines of closer ones.
double hidden_share(const Seen& object, const std::vector<Seen>& seen) {
  constexpr int kSamples = 16;
  int hidden = 0;
  for (int row = 0; row < kSamples; ++row) {
    for (int column = 0; column < kSamples; ++column) {
      const Eigen::Array2d share((column + 0.5) / kSamples, (row + 0.5) / kSamples);
      const Eigen::Vector2d pixel =
          object.visible.min() + (share * object.visible.sizes().array()).matrix();
      for (const Seen& other : seen) {
        if (other.centre_cam.z() >= object.centre_cam.z() || !other.visible.contains(pixel)) {
          continue;
        }
        ++hidden;
        break;
      }
    }
  }
  return static_cast<double>(hidden) / (kSamples * kSamples);
}

std::string label_of(const Seen& object, const std::vector<Seen>& seen, const KittiCamera& camera) {
  const maps::Box& box = *object.box;
  const Eigen::Vector3d heading =
      camera.T_cam_lidar.linear() *
      Eigen::Vector3d(std::cos(box.yaw_rad), std::sin(box.yaw_rad), 0.0);
  const double ry = std::atan2(-heading.z(), heading.x());
  const Eigen::Vector3d& c = object.centre_cam;
  const double alpha = std::remainder(ry - std::atan2(c.x(), c.z()), 2.0 * std::numbers::pi);
  const double cut = 1.0 - object.visible.volume() / object.whole.volume();
  // Any cut at all counts as some.
  const int truncation = cut > 0.0 ? std::max(1, level_of(cut)) : 0;
  const Outline& v = object.visible;
  return fmt::format(
      "{} {} {} {} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f} "
      "{:.6f}\n",
      box.track, type_of(box.object_class), truncation, level_of(hidden_share(object, seen)), alpha,
      v.min().x(), v.min().y(), v.max().x(), v.max().y(), box.size_m.z(), box.size_m.y(),
      box.size_m.x(), c.x(), c.y() + 0.5 * box.size_m.z(), c.z(), ry);
}

}  // namespace

std::string tracking_labels(std::size_t frame, const std::vector<maps::Box>& boxes,
                            const KittiCamera& camera) {
  const std::vector<Seen> seen = seen_boxes(boxes, camera);
  std::string lines;
  for (const Seen& object : seen) {
    lines += fmt::format("{} ", frame) + label_of(object, seen, camera);
  }
  return lines;
}

}  // namespace stillmap::simulation

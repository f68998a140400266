#include <fmt/format.h>
#include <stillmap/mapping/projection.hpp>

#include <cmath>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

void check(const maps::PointCloud& cloud, const GroundResult& ground,
           const std::vector<maps::Box>& boxes, const ProjectionOptions& options) {
  if (const auto broken = options.violations(); !broken.empty()) {
    throw std::invalid_argument("projection options: " + broken.front());
  }
  if (ground.is_ground.size() != cloud.size()) {
    throw std::invalid_argument(fmt::format("ground flags: {}, expected one a point ({})",
                                            ground.is_ground.size(), cloud.size()));
  }
  if (!ground.surface) throw std::invalid_argument("ground surface: none, expected one");
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const maps::Box& box = boxes[b];
    const bool usable = box.centre.allFinite() && box.size_m.allFinite() &&
                        (box.size_m.array() > 0.0).all() && std::isfinite(box.yaw_rad);
    if (!usable) {
      throw std::invalid_argument(
          fmt::format("box {}: centre {} {} {}, size {} {} {}, yaw {}; expected finite numbers and "
                      "sizes > 0",
                      b, box.centre.x(), box.centre.y(), box.centre.z(), box.size_m.x(),
                      box.size_m.y(), box.size_m.z(), box.yaw_rad));
    }
  }
}

/// A box with what its containment test needs, computed once.
struct PreparedBox {
  Eigen::Vector3f centre;
  Eigen::Vector3f half;
  float cosine;
  float sine;
  float radius_squared;

  PreparedBox(const maps::Box& box, double margin_m)
      : centre(box.centre.cast<float>()),
        half((0.5 * box.size_m + Eigen::Vector3d::Constant(margin_m)).cast<float>()),
        cosine(static_cast<float>(std::cos(box.yaw_rad))),
        sine(static_cast<float>(std::sin(box.yaw_rad))),
        radius_squared(half.x() * half.x() + half.y() * half.y()) {}

  [[nodiscard]] bool contains(const Eigen::Vector3f& p) const {
    const Eigen::Vector3f d = p - centre;
    if (d.x() * d.x() + d.y() * d.y() > radius_squared) return false;
    return std::abs(cosine * d.x() + sine * d.y()) <= half.x() &&
           std::abs(cosine * d.y() - sine * d.x()) <= half.y() && std::abs(d.z()) <= half.z();
  }
};

void move_point(std::size_t i, const GroundSurface& surface, const ProjectionOptions& options,
                ProjectionResult& result) {
  if (options.policy == MovablePolicy::kKeep) return;
  result.fates[i] = PointFate::kDeleted;
  if (options.policy == MovablePolicy::kDelete) return;
  Eigen::Vector3f& p = result.positions[i];
  const auto below = surface.at(static_cast<double>(p.x()), static_cast<double>(p.y()));
  if (!below) {
    ++result.without_ground;
    return;
  }
  p.z() = static_cast<float>(below->z);
  result.fates[i] = PointFate::kProjected;
}

void count_fates(ProjectionResult& result) {
  for (const PointFate fate : result.fates) {
    switch (fate) {
      case PointFate::kKept:
        ++result.kept;
        break;
      case PointFate::kGround:
        ++result.ground;
        break;
      case PointFate::kProjected:
        ++result.projected;
        break;
      case PointFate::kDeleted:
        ++result.deleted;
        break;
      case PointFate::kDropped:
        break;
    }
  }
}

}  // namespace

MovablePolicy movable_policy_from(std::string_view text) {
  for (const MovablePolicy policy :
       {MovablePolicy::kProject, MovablePolicy::kDelete, MovablePolicy::kKeep}) {
    if (text == name_of(policy)) return policy;
  }
  throw std::invalid_argument(
      fmt::format("movable policy: found '{}', expected project, delete or keep", text));
}

std::string_view name_of(MovablePolicy policy) {
  switch (policy) {
    case MovablePolicy::kProject:
      return "project";
    case MovablePolicy::kDelete:
      return "delete";
    case MovablePolicy::kKeep:
      return "keep";
  }
  throw std::invalid_argument("movable policy: not one of the enumerators");
}

std::vector<std::string> ProjectionOptions::violations() const {
  std::vector<std::string> broken;
  if (!(margin_m >= 0.0 && margin_m <= 1.0)) {
    broken.push_back(fmt::format("margin_m: {}, expected in [0, 1]", margin_m));
  }
  return broken;
}

ProjectionResult project_objects(const maps::PointCloud& cloud, const GroundResult& ground,
                                 const std::vector<maps::Box>& boxes,
                                 const ProjectionOptions& options) {
  check(cloud, ground, boxes, options);
  std::vector<PreparedBox> prepared;
  prepared.reserve(boxes.size());
  for (const maps::Box& box : boxes) prepared.emplace_back(box, options.margin_m);

  ProjectionResult result;
  result.positions = cloud.positions;
  result.fates.assign(cloud.size(), PointFate::kKept);
  result.object_of_point.assign(cloud.size(), 0);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (ground.is_ground[i] != 0) {
      result.fates[i] = PointFate::kGround;
      continue;
    }
    for (std::size_t b = 0; b < prepared.size(); ++b) {
      if (!prepared[b].contains(cloud.positions[i])) continue;
      // The first box wins where boxes overlap: a point belongs to one object.
      result.object_of_point[i] = static_cast<std::uint32_t>(b + 1);
      move_point(i, *ground.surface, options, result);
      break;
    }
  }
  count_fates(result);
  return result;
}

}  // namespace stillmap::mapping

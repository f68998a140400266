#include "projection/box_columns.hpp"

#include <fmt/format.h>
#include <stillmap/mapping/projection.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// What is this near to the ground counts as ground even if it was not labelled so [m]: the noise
/// of ranges and of the surface.
constexpr double kOnGroundM = 0.05;
/// Nothing above this is a car's [m]; crowns and bridges are.
constexpr double kMaxHeightM = 3.5;
/// Larger than any map [m], or faster than anything on a road [m/s]. Boxes become floats, where
/// what is finite as a double may be infinite.
constexpr double kMost = 1e8;

void check(const maps::PointCloud& cloud, std::size_t flags, std::span<const MovableBox> boxes,
           const ProjectionOptions& options) {
  if (const auto broken = options.violations(); !broken.empty()) {
    throw std::invalid_argument("projection options: " + broken.front());
  }
  if (flags != cloud.size()) {
    throw std::invalid_argument(
        fmt::format("ground flags: {}, expected one a point ({})", flags, cloud.size()));
  }
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const auto& [box, speed_mps] = boxes[b];
    // Written so that a NaN fails.
    const bool usable = (box.centre.array().abs() <= kMost).all() &&
                        (box.size_m.array() > 0.0).all() && (box.size_m.array() <= kMost).all() &&
                        std::isfinite(box.yaw_rad) && std::abs(speed_mps) <= kMost;
    if (!usable) {
      throw std::invalid_argument(
          fmt::format("box {}: centre {} {} {}, size {} {} {}, yaw {}, speed {}; expected finite "
                      "numbers within "
                      "{:g} and sizes > 0",
                      b, box.centre.x(), box.centre.y(), box.centre.z(), box.size_m.x(),
                      box.size_m.y(), box.size_m.z(), box.yaw_rad, speed_mps, kMost));
    }
  }
}

[[nodiscard]] bool is_tall(maps::ObjectClass object_class) {
  switch (object_class) {
    case maps::ObjectClass::kTruck:
    case maps::ObjectClass::kBus:
    case maps::ObjectClass::kTrailer:
    case maps::ObjectClass::kTram:
      return true;
    default:
      return false;
  }
}

/// What one point in a box is, by its height over the ground.
enum class Part { kGround, kObject, kNeither };

[[nodiscard]] Part part_of(const GroundBelow::Foot& foot, bool labelled_ground,
                           maps::ObjectClass object_class) {
  if (labelled_ground) return foot.height_m <= foot.tolerance_m ? Part::kGround : Part::kObject;
  if (foot.height_m < -kOnGroundM) return Part::kNeither;
  if (foot.height_m <= kOnGroundM) return Part::kGround;
  return foot.height_m <= kMaxHeightM || is_tall(object_class) ? Part::kObject : Part::kNeither;
}

class Projector {
 public:
  Projector(const maps::PointCloud& cloud, const std::vector<std::uint8_t>& is_ground,
            std::span<const MovableBox> boxes, const ProjectionOptions& options)
      : is_ground_(is_ground), boxes_(boxes), options_(options), columns_(boxes, options) {
    result_.positions = cloud.positions;
    result_.fates.assign(cloud.size(), PointFate::kKept);
    result_.object_of_point.assign(cloud.size(), 0);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (is_ground[i] != 0) result_.fates[i] = PointFate::kGround;
    }
  }

  ProjectionResult down_to(const GroundBelow& below) && {
    for (std::size_t i = 0; i < is_ground_.size(); ++i) {
      const Eigen::Vector3f p = result_.positions[i];
      const int box = columns_.first_with(p);
      if (box < 0) continue;
      const auto foot = below.below(p);
      const auto object_class = boxes_[static_cast<std::size_t>(box)].box.object_class;
      const bool labelled = is_ground_[i] != 0;
      if (!foot) {
        if (!labelled) take(i, box, nullptr);
        continue;
      }
      const Part part = part_of(*foot, labelled, object_class);
      if (part == Part::kGround) result_.fates[i] = PointFate::kGround;
      if (part != Part::kObject) continue;
      if (labelled) ++result_.ground_taken_back;
      take(i, box, &foot->position);
    }
    return counted();
  }

  ProjectionResult down_to_mean() && {
    const auto mean_z = mean_ground_z();
    for (std::size_t i = 0; i < is_ground_.size(); ++i) {
      if (is_ground_[i] != 0) continue;
      const Eigen::Vector3f p = result_.positions[i];
      const int box = columns_.first_with(p);
      if (box < 0) continue;
      const Eigen::Vector3f foot(p.x(), p.y(), mean_z.value_or(0.0F));
      take(i, box, mean_z ? &foot : nullptr);
    }
    return counted();
  }

 private:
  /// The paper's eq. (10), of heights.
  [[nodiscard]] std::optional<float> mean_ground_z() const {
    double sum = 0.0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < is_ground_.size(); ++i) {
      if (is_ground_[i] == 0) continue;
      sum += static_cast<double>(result_.positions[i].z());
      ++count;
    }
    if (count == 0) return std::nullopt;
    return static_cast<float>(sum / static_cast<double>(count));
  }

  /// @param foot  null where no ground is known.
  void take(std::size_t i, int box, const Eigen::Vector3f* foot) {
    result_.object_of_point[i] = static_cast<std::uint32_t>(box) + 1;
    if (options_.policy == MovablePolicy::kKeep) {
      result_.fates[i] = PointFate::kKept;
      return;
    }
    result_.fates[i] = PointFate::kDeleted;
    if (options_.policy == MovablePolicy::kDelete) return;
    if (foot == nullptr) {
      ++result_.without_ground;
      return;
    }
    result_.positions[i] = *foot;
    result_.fates[i] = PointFate::kProjected;
  }

  ProjectionResult counted() {
    const auto count = [&](PointFate fate) {
      return static_cast<std::size_t>(std::count(result_.fates.begin(), result_.fates.end(), fate));
    };
    result_.kept = count(PointFate::kKept);
    result_.ground = count(PointFate::kGround);
    result_.projected = count(PointFate::kProjected);
    result_.deleted = count(PointFate::kDeleted);
    return std::move(result_);
  }

  const std::vector<std::uint8_t>& is_ground_;
  std::span<const MovableBox> boxes_;
  const ProjectionOptions& options_;
  BoxColumns columns_;
  ProjectionResult result_;
};

}  // namespace

std::optional<GroundBelow::Foot> BelowLocal::below(const Eigen::Vector3f& p) const {
  // A scan's own surface is coarse: what it calls ground stays ground.
  constexpr double kToleranceM = 0.3;
  const auto sample = surface_.at(static_cast<double>(p.x()), static_cast<double>(p.y()));
  if (!sample) return std::nullopt;
  return Foot{{p.x(), p.y(), static_cast<float>(sample->z)},
              static_cast<double>(p.z()) - sample->z,
              kToleranceM,
              sample->confidence};
}

ProjectionResult project_objects(const maps::PointCloud& cloud,
                                 const std::vector<std::uint8_t>& is_ground,
                                 const GroundBelow& below, std::span<const MovableBox> boxes,
                                 const ProjectionOptions& options) {
  check(cloud, is_ground.size(), boxes, options);
  Projector projector(cloud, is_ground, boxes, options);
  if (options.ground_height == GroundHeight::kMean) return std::move(projector).down_to_mean();
  return std::move(projector).down_to(below);
}

ProjectionResult project_objects(const maps::PointCloud& cloud, const GroundResult& ground,
                                 const std::vector<maps::Box>& boxes,
                                 const ProjectionOptions& options) {
  if (!ground.surface) throw std::invalid_argument("ground surface: none, expected one");
  std::vector<MovableBox> still;
  still.reserve(boxes.size());
  for (const maps::Box& box : boxes) still.push_back({box, 0.0});
  return project_objects(cloud, ground.is_ground, BelowLocal(*ground.surface), still, options);
}

}  // namespace stillmap::mapping

#include "evaluation/detector/point_tally.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>

namespace stillmap::mapping {
namespace {

/// Parked and moving objects of a class are one here.
std::uint16_t resting_label(std::uint16_t label) {
  switch (label) {
    case 252:
      return 10;
    case 253:
      return 31;
    case 254:
      return 30;
    case 255:
      return 32;
    case 256:
      return 16;
    case 257:
      return 13;
    case 258:
      return 18;
    case 259:
      return 20;
    default:
      return label;
  }
}

void add(Share& sum, const Share& more) {
  sum.count += more.count;
  sum.of += more.of;
}

bool is_in_any(const Eigen::Vector3d& p, const std::vector<maps::Box>& boxes, double margin_m) {
  return std::any_of(boxes.begin(), boxes.end(),
                     [&](const maps::Box& box) { return box.contains(p, margin_m); });
}

}  // namespace

std::vector<ClassIndex> classes_of(const maps::Scan& scan,
                                   const std::vector<std::uint32_t>& labels) {
  std::vector<ClassIndex> classes;
  classes.reserve(scan.cloud.size());
  for (std::size_t i = 0; i < scan.cloud.size(); ++i) {
    const std::uint32_t label = labels.at(scan.cloud.file_index(i));
    const ClassIndex index = class_index(label);
    if (index == no_class()) {
      throw maps::InputError(
          scan.source,
          fmt::format("label {} of point {}", label & 0xFFFFU, scan.cloud.file_index(i)),
          "a class of SemanticKITTI");
    }
    classes.push_back(index);
  }
  return classes;
}

void PointTally::add(const maps::PointCloud& cloud, const std::vector<ClassIndex>& classes,
                     const std::vector<std::uint8_t>& is_ground,
                     const std::vector<maps::Box>& boxes) {
  ++scans_;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3d p = cloud.positions[i].cast<double>();
    const ClassKind kind = semantic_classes()[classes[i]].kind;
    if (kind == ClassKind::kIgnored || !(p.head<2>().norm() < max_range_m_)) continue;
    const Share one{is_in_any(p, boxes, margin_m_) ? std::size_t{1} : std::size_t{0}, 1};
    mapping::add(by_class_[classes[i]], one);
    if (kind == ClassKind::kStays && is_ground[i] == 0) mapping::add(stays_above_ground_, one);
  }
}

PointDetection PointTally::result() const {
  PointDetection out;
  out.scans = scans_;
  out.stays_above_ground = stays_above_ground_;
  for (std::size_t i = 0; i < semantic_classes().size(); ++i) {
    const SemanticClass& semantic = semantic_classes()[i];
    if (by_class_[i].of == 0) continue;
    const bool movable = semantic.kind != ClassKind::kStays;
    mapping::add(movable ? out.movable : out.stays, by_class_[i]);
    const std::string name(semantic_classes()[class_index(resting_label(semantic.label))].name);
    auto known = std::find_if(out.classes.begin(), out.classes.end(),
                              [&](const ClassPoints& each) { return each.name == name; });
    if (known == out.classes.end()) known = out.classes.insert(known, {name, movable, {}});
    mapping::add(known->inside, by_class_[i]);
  }
  return out;
}

std::string content_of(const maps::Box& box, const maps::PointCloud& cloud,
                       const std::vector<ClassIndex>& classes,
                       const std::vector<std::uint8_t>& is_ground) {
  std::array<std::size_t, 256> counts{};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const bool known = semantic_classes()[classes[i]].kind != ClassKind::kIgnored;
    if (known && is_ground[i] == 0 && box.contains(cloud.positions[i].cast<double>()))
      ++counts[classes[i]];
  }
  const auto most = std::max_element(counts.begin(), counts.end());
  if (*most == 0) return "nothing";
  return std::string(semantic_classes()[static_cast<std::size_t>(most - counts.begin())].name);
}

}  // namespace stillmap::mapping

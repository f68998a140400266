#include "evaluation/labels/semantic_classes.hpp"

#include <algorithm>
#include <array>

namespace stillmap::mapping {
namespace {

using enum ClassKind;

constexpr std::array<SemanticClass, 34> kClasses{{
    {0, "unlabelled", kIgnored},
    {1, "outlier", kIgnored},
    {10, "car", kParked},
    {11, "bicycle", kParked},
    {13, "bus", kParked},
    {15, "motorcycle", kParked},
    {16, "on rails", kParked},
    {18, "truck", kParked},
    {20, "other vehicle", kParked},
    {30, "person", kParked},
    {31, "bicyclist", kParked},
    {32, "motorcyclist", kParked},
    {40, "road", kStays},
    {44, "parking", kStays},
    {48, "pavement", kStays},
    {49, "other ground", kStays},
    {50, "building", kStays},
    {51, "fence", kStays},
    {52, "other structure", kStays},
    {60, "lane marking", kStays},
    {70, "vegetation", kStays},
    {71, "trunk", kStays},
    {72, "terrain", kStays},
    {80, "pole", kStays},
    {81, "traffic sign", kStays},
    {99, "other object", kStays},
    {252, "moving car", kMoving},
    {253, "moving bicyclist", kMoving},
    {254, "moving person", kMoving},
    {255, "moving motorcyclist", kMoving},
    {256, "moving on rails", kMoving},
    {257, "moving bus", kMoving},
    {258, "moving truck", kMoving},
    {259, "moving other vehicle", kMoving},
}};

constexpr std::size_t kLabels = 260;

constexpr std::array<ClassIndex, kLabels> indices_by_label() {
  std::array<ClassIndex, kLabels> indices{};
  indices.fill(kClasses.size());
  for (std::size_t i = 0; i < kClasses.size(); ++i)
    indices[kClasses[i].label] = static_cast<ClassIndex>(i);
  return indices;
}

constexpr std::array<ClassIndex, kLabels> kIndices = indices_by_label();

}  // namespace

std::span<const SemanticClass> semantic_classes() { return kClasses; }

ClassIndex no_class() { return kClasses.size(); }

ClassIndex class_index(std::uint32_t label) {
  // The high 16 bits number the instance.
  const std::uint32_t number = label & 0xFFFFU;
  return number < kLabels ? kIndices[number] : no_class();
}

GroundTruth ground_truth(ClassIndex index) {
  switch (kClasses.at(index).label) {
    case 40:
    case 44:
    case 48:
    case 49:
    case 60:
    case 72:
      return GroundTruth::kGround;
    case 0:
    case 1:
    case 70:
      return GroundTruth::kLeftOut;
    default:
      return GroundTruth::kOther;
  }
}

}  // namespace stillmap::mapping

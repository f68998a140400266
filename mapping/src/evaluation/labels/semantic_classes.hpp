#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// What a class of SemanticKITTI is to the judgement of a map.
enum class ClassKind : std::uint8_t {
  kIgnored,  ///< nothing is known of the point
  kStays,
  kParked,  ///< could move, and did not during the drive
  kMoving,
};

struct SemanticClass {
  std::uint16_t label = 0;
  std::string_view name;
  ClassKind kind = ClassKind::kIgnored;
};

/// All classes, by label.
/// @see Behley et al., "SemanticKITTI", ICCV 2019; names and numbers of its semantic-kitti.yaml.
[[nodiscard]] std::span<const SemanticClass> semantic_classes();

/// Positions in `semantic_classes()`, below 256.
using ClassIndex = std::uint8_t;
/// Position of the class of a point [low 16 bits of its label], `no_class()` when there is none.
[[nodiscard]] ClassIndex class_index(std::uint32_t label);
[[nodiscard]] ClassIndex no_class();

/// The Patchwork++ protocol: what counts as ground, and what is left out.
/// @see Lee, Lim, Myung, "Patchwork++", IROS 2022, section IV-A.
enum class GroundTruth : std::uint8_t { kLeftOut, kGround, kOther };
[[nodiscard]] GroundTruth ground_truth(ClassIndex index);

}  // namespace stillmap::mapping

#pragma once

#include "evaluation/labels/semantic_classes.hpp"
#include "evaluation/published_metrics.hpp"

#include <stillmap/mapping/label_evaluation.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

namespace stillmap::mapping {

/// What a map holds of the truth points of one class.
struct ClassCounts {
  /// Points, and those within 50 m of their sensor.
  std::size_t points = 0;
  std::size_t near = 0;
  /// Of the near ones: with a map point of any kind, and with a measured one, within 0.05 m.
  std::size_t same_any = 0;
  std::size_t same_measured = 0;
  /// Of all: without a measured map point within 0.1 m.
  std::size_t lost = 0;
};

/// What a map holds of all truth points.
struct ClassTally {
  std::array<ClassCounts, 64> by_class{};
  /// Points of parked objects more than 0.3 m over true ground, and those of them without a map
  /// point of any kind within 0.1 m.
  Share parked;

  /// Where a truth point was met: as the bits of `RemovedPoints::Met`.
  void add(ClassIndex index, bool near, bool parked_high, unsigned met);
  [[nodiscard]] BenchmarkCounts benchmark(TruthClasses classes, bool measured_only) const;
  /// Of static points.
  [[nodiscard]] Share lost(TruthClasses classes) const;
};

/// Height over true ground from which on a point of a parked object counts [m].
inline constexpr float kParkedHeightM = 0.3F;

[[nodiscard]] bool is_dynamic(ClassKind kind, TruthClasses classes);
/// By position in `semantic_classes()`: 1 = dynamic.
[[nodiscard]] std::array<std::uint8_t, 256> dynamic_kinds(TruthClasses classes);
/// Neither dynamic nor ignored.
[[nodiscard]] bool is_static(ClassKind kind, TruthClasses classes);

}  // namespace stillmap::mapping

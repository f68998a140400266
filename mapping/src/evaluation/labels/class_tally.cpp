#include "evaluation/labels/class_tally.hpp"

#include "evaluation/labels/removed_points.hpp"

namespace stillmap::mapping {

bool is_dynamic(ClassKind kind, TruthClasses classes) {
  return kind == ClassKind::kMoving ||
         (kind == ClassKind::kParked && classes == TruthClasses::kMovable);
}

std::array<std::uint8_t, 256> dynamic_kinds(TruthClasses classes) {
  std::array<std::uint8_t, 256> flags{};
  for (std::size_t i = 0; i < semantic_classes().size(); ++i)
    flags[i] = is_dynamic(semantic_classes()[i].kind, classes) ? 1 : 0;
  return flags;
}

bool is_static(ClassKind kind, TruthClasses classes) {
  return kind != ClassKind::kIgnored && !is_dynamic(kind, classes);
}

void ClassTally::add(ClassIndex index, bool near, bool parked_high, unsigned met) {
  ClassCounts& counts = by_class.at(index);
  ++counts.points;
  counts.lost += (met & RemovedPoints::kMeasuredNear) == 0 ? 1 : 0;
  if (near) {
    ++counts.near;
    counts.same_any += (met & RemovedPoints::kAnySame) != 0 ? 1 : 0;
    counts.same_measured += (met & RemovedPoints::kMeasuredSame) != 0 ? 1 : 0;
  }
  if (parked_high) {
    ++parked.of;
    parked.count += (met & RemovedPoints::kAnyNear) == 0 ? 1 : 0;
  }
}

BenchmarkCounts ClassTally::benchmark(TruthClasses classes, bool measured_only) const {
  BenchmarkCounts sum;
  for (std::size_t i = 0; i < semantic_classes().size(); ++i) {
    const ClassCounts& counts = by_class[i];
    const ClassKind kind = semantic_classes()[i].kind;
    if (is_dynamic(kind, classes)) {
      sum.truth_dynamic += counts.near;
      sum.dynamic_removed += counts.near - (measured_only ? counts.same_measured : counts.same_any);
    } else if (is_static(kind, classes)) {
      sum.truth_static += counts.near;
      sum.static_kept += counts.same_any;
    }
  }
  return sum;
}

Share ClassTally::lost(TruthClasses classes) const {
  Share sum;
  for (std::size_t i = 0; i < semantic_classes().size(); ++i) {
    if (!is_static(semantic_classes()[i].kind, classes)) continue;
    sum.count += by_class[i].lost;
    sum.of += by_class[i].points;
  }
  return sum;
}

}  // namespace stillmap::mapping

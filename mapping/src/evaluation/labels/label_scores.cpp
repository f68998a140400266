#include <stillmap/mapping/label_evaluation.hpp>

#include <limits>

namespace stillmap::mapping {
namespace {

double ratio(std::size_t part, std::size_t whole) { return Share{part, whole}.rate(); }

}  // namespace

std::string_view name_of(TruthClasses classes) {
  return classes == TruthClasses::kMoving ? "moving" : "movable";
}

std::string_view name_of(TrueGround ground) {
  switch (ground) {
    case TrueGround::kSurface:
      return "surface";
    case TrueGround::kLabels:
      return "labels";
    case TrueGround::kNone:
      break;
  }
  return "none";
}

double Share::rate() const {
  if (of == 0) return std::numeric_limits<double>::quiet_NaN();
  return static_cast<double>(count) / static_cast<double>(of);
}

double GroundScores::precision() const {
  return ratio(true_positives, true_positives + false_positives);
}

double GroundScores::recall() const {
  return ratio(true_positives, true_positives + false_negatives);
}

double GroundScores::f1() const {
  return ratio(2 * true_positives, 2 * true_positives + false_positives + false_negatives);
}

}  // namespace stillmap::mapping

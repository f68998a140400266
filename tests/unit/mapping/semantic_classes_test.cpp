#include "evaluation/labels/semantic_classes.hpp"

#include <gtest/gtest.h>

#include <set>

namespace stillmap::mapping {
namespace semantic_classes_test {

std::set<int> labels_of(ClassKind kind) {
  std::set<int> labels;
  for (const SemanticClass& one : semantic_classes()) {
    if (one.kind == kind) labels.insert(one.label);
  }
  return labels;
}

TEST(SemanticClasses, MovingAndMovableAreTheOnesOfTheProtocol) {
  EXPECT_EQ(labels_of(ClassKind::kMoving), (std::set<int>{252, 253, 254, 255, 256, 257, 258, 259}));
  EXPECT_EQ(labels_of(ClassKind::kParked), (std::set<int>{10, 11, 13, 15, 16, 18, 20, 30, 31, 32}));
  EXPECT_EQ(labels_of(ClassKind::kIgnored), (std::set<int>{0, 1}));
}

TEST(SemanticClasses, AreFoundByLabelWhateverTheInstance) {
  for (std::size_t i = 0; i < semantic_classes().size(); ++i) {
    EXPECT_EQ(class_index(semantic_classes()[i].label), i);
    EXPECT_EQ(class_index(semantic_classes()[i].label | 0x00070000U), i);
  }
  EXPECT_EQ(class_index(2), no_class());
  EXPECT_EQ(class_index(260), no_class());
  EXPECT_EQ(class_index(0xFFFFU), no_class());
}

TEST(SemanticClasses, GroundIsWhatPatchworkCounts) {
  std::set<int> ground, left_out;
  for (std::size_t i = 0; i < semantic_classes().size(); ++i) {
    const auto truth = ground_truth(static_cast<ClassIndex>(i));
    if (truth == GroundTruth::kGround) ground.insert(semantic_classes()[i].label);
    if (truth == GroundTruth::kLeftOut) left_out.insert(semantic_classes()[i].label);
  }
  EXPECT_EQ(ground, (std::set<int>{40, 44, 48, 49, 60, 72}));
  EXPECT_EQ(left_out, (std::set<int>{0, 1, 70}));
}

}  // namespace semantic_classes_test
}  // namespace stillmap::mapping

#include <stillmap/mapping/octomap_export.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <octomap/OcTree.h>
#include <stillmap/maps/error.hpp>

#include <stdexcept>

#include "support/exported_map.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace octomap_export_test {

using test::ThrowsSaying;
using enum maps::PointKind;

test::SmallMap sample() {
  test::SmallMap map;
  map.origin = {1000.0, -500.0, 20.0};
  map.points = {{{0.05F, 0.05F, 0.05F}, 0.0F, kMeasured},
                {{0.06F, 0.07F, 0.05F}, 0.0F, kMeasured},
                {{5.0F, -0.31F, 1.0F}, 0.0F, kGround},
                {{-3.1F, 2.1F, 0.1F}, 0.0F, kFilled}};
  return map;
}

class OctomapExport : public ::testing::Test {
 protected:
  std::unique_ptr<octomap::OcTree> exported(const maps::MapExportOptions& options,
                                            const std::string& name) {
    report_ = export_octomap(*package_, folder_.path() / name, options);
    auto tree = std::make_unique<octomap::OcTree>(1.0);
    EXPECT_TRUE(tree->readBinary((folder_.path() / name).string()));
    return tree;
  }
  static bool is_occupied(const octomap::OcTree& tree, double x, double y, double z) {
    const octomap::OcTreeNode* node = tree.search(x, y, z);
    return node != nullptr && tree.isNodeOccupied(node);
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const maps::MapPackage> package_ =
      test::published(sample(), folder_.path() / "map");
  maps::MapExportResult report_;
};

TEST_F(OctomapExport, PointsAreOccupiedLeavesOfTheLibrarysTree) {
  const auto tree = exported({}, "a.bt");
  EXPECT_EQ(tree->getResolution(), 0.2);
  EXPECT_TRUE(is_occupied(*tree, 1000.05, -499.95, 20.05));
  EXPECT_TRUE(is_occupied(*tree, 1005.0, -500.31, 21.0));
  EXPECT_TRUE(is_occupied(*tree, 996.9, -497.9, 20.1));
  EXPECT_FALSE(is_occupied(*tree, 1002.0, -500.0, 20.0));
  EXPECT_EQ(tree->getNumLeafNodes(), 3U);
  EXPECT_EQ(report_.points, 4U);
  EXPECT_EQ(report_.counts.at("leaves"), 3U);
}

TEST_F(OctomapExport, FrameResolutionAndChoiceAreTheUsers) {
  const auto tree = exported(
      {.without = {kProjected, kFilled}, .frame = maps::ExportFrame::kLocal, .resolution_m = 0.5},
      "a.bt");
  EXPECT_EQ(tree->getResolution(), 0.5);
  EXPECT_TRUE(is_occupied(*tree, 0.05, 0.05, 0.05));
  EXPECT_FALSE(is_occupied(*tree, -3.1, 2.1, 0.1));
  EXPECT_EQ(report_.origin, sample().origin);
}

TEST_F(OctomapExport, MapsBeyondTheTreeAreRefusedWithTheRemedy) {
  EXPECT_THAT([&] { exported({.resolution_m = 0.02}, "a.bt"); },
              ThrowsSaying<maps::InputError>({"a point at 996.", "655 m", "--resolution"}));
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "a.bt"));
  EXPECT_THAT([&] { exported({.kinds = true}, "a.bt"); },
              ThrowsSaying<std::invalid_argument>({"kinds", "octomap"}));
}

}  // namespace octomap_export_test
}  // namespace stillmap::mapping

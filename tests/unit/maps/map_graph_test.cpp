#include <stillmap/maps/map_graph.hpp>

#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>

#include <fstream>
#include <numbers>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace map_graph_test {

using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

Trajectory straight(std::size_t poses, double step_m) {
  std::vector<StampedPose> each(poses);
  for (std::size_t i = 0; i < poses; ++i) {
    each[i].stamp_ns = static_cast<std::int64_t>(i);
    each[i].T_map_lidar.translation().x() = step_m * static_cast<double>(i);
  }
  return Trajectory(std::move(each));
}

class MapGraphTest : public ::testing::Test {
 protected:
  /// A package of two drives with three poses each. @param graph  text of its file; empty = none.
  std::shared_ptr<const MapPackage> package(const std::string& graph) {
    const std::filesystem::path target = folder_.path() / ("map" + std::to_string(count_++));
    MapPackageWriter writer(target);
    writer.add_tile({}, std::vector<MapPoint>(1));
    for (std::size_t drive = 0; drive < 2; ++drive)
      writer.write_trajectory(straight(3, 1.0), drive);
    if (!graph.empty()) std::ofstream(writer.folder() / "graph.json") << graph;
    MapManifest manifest;
    manifest.frame_id = "map";
    writer.publish(manifest, "{}");
    return MapPackage::open(target);
  }
  static std::string text(const std::string& key_frames, const std::string& loops) {
    return R"({"format": "stillmap-graph", "version": 1, "key_frames": [)" + key_frames +
           R"(], "loops": [)" + loops + "]}";
  }

  TemporaryFolder folder_;
  int count_ = 0;
};

TEST_F(MapGraphTest, ComesBackAsItWasWritten) {
  write_map_graph(folder_.path(), {.key_frames = {0, 2, 5}, .loops = {{4, 1, 0.25}, {5, 0, 1.0}}});
  std::ifstream file(folder_.path() / "graph.json");
  const auto graph = read_map_graph(*package({std::istreambuf_iterator<char>(file), {}}));
  ASSERT_TRUE(graph);
  EXPECT_THAT(graph->key_frames, ElementsAre(0U, 2U, 5U));
  EXPECT_THAT(graph->loops, ElementsAre(MapGraph::Loop{4, 1, 0.25}, MapGraph::Loop{5, 0, 1.0}));
}

TEST_F(MapGraphTest, IsNothingWhereThePackageSaysNothing) {
  EXPECT_FALSE(read_map_graph(*package({})));
}

TEST_F(MapGraphTest, BrokenOnesAreRefusedByFileAndKey) {
  const auto refused = [&](const std::string& graph, const std::vector<std::string>& says) {
    const auto map = package(graph);
    EXPECT_THAT([&] { (void)read_map_graph(*map); }, ThrowsSaying<InputError>(says)) << graph;
  };
  refused("{", {"graph.json"});
  refused(R"({"format": "other"})", {".format"});
  refused(R"({"format": "stillmap-graph", "version": 2})", {".version"});
  refused(text("6", ""), {".key_frames[0]", "below 6"});
  refused(text("-1", ""), {".key_frames[0]"});
  refused(text("1, 1", ""), {".key_frames[1]", "ascend"});
  refused(text("0", R"({"from": 0, "to": 6, "weight": 1})"), {".loops[0].to", "below 6"});
  refused(text("0", R"({"from": 0, "to": 1, "weight": 1.5})"), {".loops[0].weight"});
  refused(text("0", R"({"from": 0, "to": 1})"), {".loops[0].weight", "nothing"});
}

TEST(DerivedKeyFrames, AreAMetreOrTenDegreesApart) {
  EXPECT_THAT(derived_key_frames({}), IsEmpty());
  EXPECT_THAT(derived_key_frames({straight(5, 0.5)}), ElementsAre(0U, 2U, 4U));
  // Each drive begins with one, and numbers go on.
  EXPECT_THAT(derived_key_frames({straight(3, 0.25), straight(2, 1.0)}), ElementsAre(0U, 3U, 4U));
  std::vector<StampedPose> turning(4);
  for (std::size_t i = 0; i < turning.size(); ++i) {
    turning[i].stamp_ns = static_cast<std::int64_t>(i);
    turning[i].T_map_lidar.rotate(Eigen::AngleAxisd(
        6.0 * std::numbers::pi / 180.0 * static_cast<double>(i), Eigen::Vector3d::UnitZ()));
  }
  EXPECT_THAT(derived_key_frames({Trajectory(turning)}), ElementsAre(0U, 2U));
}

}  // namespace map_graph_test
}  // namespace stillmap::maps

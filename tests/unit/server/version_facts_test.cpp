#include "catalog/version_facts.hpp"

#include <gmock/gmock.h>

#include <stillmap/maps/map_graph.hpp>

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service_fixture.hpp"
#include "store/store_migration.hpp"
#include "support/stored_packages.hpp"

namespace stillmap::server {
namespace version_facts_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

maps::TileEntry tile(std::uint32_t level, std::uint64_t points, float width, float height) {
  return {.id = {.level = level},
          .points = points,
          .min = {-1.0F, 2.0F, 0.0F},
          .max = {-1.0F + width, 2.0F + height, 7.0F}};
}

TEST(VersionFacts, AreaAndPointsAreThoseOfTheFinestLevel) {
  maps::MapManifest manifest;
  for (const maps::TileEntry& each :
       {tile(0, 5, 20.0F, 10.0F), tile(0, 1, 0.0F, 0.0F), tile(1, 3, 40.0F, 40.0F)})
    manifest.extent.add(each);
  const VersionFacts facts = facts_of(manifest);
  EXPECT_EQ(facts.points, 6U);
  EXPECT_EQ(facts.tiles, 3U);
  EXPECT_DOUBLE_EQ(facts.area_m2, 200.0);
}

TEST(VersionFacts, DrivesComeInTheOrderOfTheBuild) {
  maps::MapManifest manifest;
  EXPECT_TRUE(facts_of(manifest).drives.empty());
  manifest.sources = {{"drive", "monday"}, {"edits_sha256", "00"}};
  for (int n = 2; n <= 11; ++n)
    manifest.sources["drive_" + std::to_string(n)] = "day" + std::to_string(n);
  EXPECT_THAT(facts_of(manifest).drives,
              ElementsAre("monday", "day2", "day3", "day4", "day5", "day6", "day7", "day8", "day9",
                          "day10", "day11"));
  manifest.sources = {{"cloud", "hall.pcd"}};
  EXPECT_THAT(facts_of(manifest).drives, ElementsAre("hall.pcd"));
}

class FrameName : public ::testing::Test {
 protected:
  void add(const std::string& digest, std::optional<std::string> registered_to,
           std::optional<maps::GeodeticOrigin> origin = {}) {
    auto facts = std::make_shared<VersionFacts>();
    facts->registered_to = std::move(registered_to);
    facts->geodetic_origin = origin;
    facts->frame_id = "enu";
    known_[digest] = facts;
  }
  std::string of(const std::string& digest) const {
    return frame_name(digest, known_.size(), [&](const std::string& each) {
      const auto found = known_.find(each);
      return found == known_.end() ? nullptr : found->second;
    });
  }
  std::map<std::string, std::shared_ptr<const VersionFacts>> known_;
};

TEST_F(FrameName, IsThatOfTheFirstOneOfAChain) {
  add("a", {});
  add("b", "a");
  add("c", "b");
  add("other", {});
  EXPECT_EQ(of("c"), of("a"));
  EXPECT_EQ(of("b"), of("a"));
  EXPECT_NE(of("other"), of("a"));
}

TEST_F(FrameName, OfOnePlaceOnEarthIsOne) {
  add("a", {}, maps::GeodeticOrigin{49.0, 8.0, 110.0});
  add("b", {}, maps::GeodeticOrigin{49.0, 8.0, 110.0});
  add("c", {}, maps::GeodeticOrigin{49.0, 8.0, 111.0});
  EXPECT_EQ(of("a"), of("b"));
  EXPECT_NE(of("a"), of("c"));
}

TEST_F(FrameName, EndsInACircleAndWhereAVersionIsGone) {
  add("a", "b");
  add("b", "a");
  add("c", "gone");
  EXPECT_FALSE(of("a").empty());
  EXPECT_EQ(of("c"), "gone");
}

class VersionList : public ServiceTest {
 protected:
  test::TemporaryFolder folder_;
};

TEST_F(VersionList, TellsHowEachWasMade) {
  maps::MapPackageWriter writer(folder_.path() / "package");
  writer.add_tile({}, std::vector<maps::MapPoint>(4));
  maps::MapManifest manifest;
  manifest.frame_id = "local";
  manifest.voxel_size_m = 0.2;
  manifest.software_version = "9.8";
  manifest.options = {{"detector", "geometric"}, {"clean", "free-space"}};
  manifest.counts = {{"scans", 12}};
  manifest.sources = {{"drive", "monday"}};
  writer.publish(manifest, "{}");
  store_.open().add("town", "v2", folder_.path() / "package");
  start();
  const nlohmann::json versions = body(get("/v1/maps/town/versions"))["versions"];
  ASSERT_EQ(versions.size(), 2U);
  EXPECT_EQ(versions[0]["state"], "ready");
  const nlohmann::json& made = versions[1];
  EXPECT_EQ(made["state"], "stored");
  EXPECT_EQ(made["active"], false);
  EXPECT_EQ(made["points"], 4);
  EXPECT_EQ(made["area_m2"], 0.0);
  EXPECT_EQ(made["options"]["clean"], "free-space");
  EXPECT_EQ(made["counts"]["scans"], 12);
  EXPECT_EQ(made["drives"], nlohmann::json{"monday"});
  EXPECT_EQ(made["software_version"], "9.8");
  EXPECT_EQ(made["voxel_size_m"], 0.2);
  EXPECT_TRUE(made["registered_to"].is_null());
  EXPECT_NE(made["frame"], versions[0]["frame"]);
  // Looking at it opens it.
  EXPECT_EQ(get("/v1/maps/town/versions/v2").status, 200);
  EXPECT_EQ(body(get("/v1/maps/town/versions"))["versions"][1]["state"], "opened");
}

TEST_F(VersionList, TellsFormerDigestsOfAMigratedPackage) {
  PackageStore& store = store_.open();
  const std::string former = test::write_package(folder_.path() / "old", 3, 100, {}, 1);
  store.add("town", "old", folder_.path() / "old");
  store.activate("town", "old");
  test::write_package(folder_.path() / "package", 1, 100,
                      maps::Registration{.previous_digest = former}, 1);
  store.add("town", "v2", folder_.path() / "package");
  migrate_store(store, plan_migration(store));
  start();
  const nlohmann::json versions = body(get("/v1/maps/town/versions"))["versions"];
  ASSERT_EQ(versions.size(), 3U);
  const nlohmann::json& old = versions[1];
  EXPECT_EQ(old["former_digests"], nlohmann::json{former});
  EXPECT_NE(old["digest"], former);
  EXPECT_EQ(versions[2]["registered_to"], old["digest"]);
  EXPECT_EQ(versions[2]["frame"], old["frame"]);
  const nlohmann::json town = body(get("/v1/maps/town"));
  EXPECT_EQ(town["digest"], old["digest"]);
  EXPECT_EQ(town["former_digests"], old["former_digests"]);
  EXPECT_EQ(body(get("/v1/maps/town/versions/v2"))["registration"]["previous_digest"],
            old["digest"]);
}

TEST_F(VersionList, SaysWhichCannotBeReadAndListsTheOthers) {
  const std::string digest = test::write_package(folder_.path() / "package", 7);
  store_.open().add("town", "v2", folder_.path() / "package");
  std::filesystem::remove(store_.folder().path() / "packages" / digest / "manifest.json");
  start();
  const HttpResponse response = get("/v1/maps/town/versions");
  ASSERT_EQ(response.status, 200);
  const nlohmann::json versions = body(response)["versions"];
  EXPECT_EQ(versions[0]["state"], "ready");
  EXPECT_EQ(versions[1]["state"], "failed");
  EXPECT_THAT(versions[1]["failure"].get<std::string>(), HasSubstr("manifest.json"));
  EXPECT_FALSE(versions[1].contains("area_m2"));
  EXPECT_THAT(response.body, Not(HasSubstr(store_.folder().path().string())));
}

/// Versions of three poses half a metre apart, which say more or less of how they came about.
class Graph : public VersionList {
 protected:
  nlohmann::json graph_of(const std::string& version,
                          const std::map<std::string, std::string>& options,
                          const std::optional<maps::MapGraph>& graph) {
    maps::MapPackageWriter writer(folder_.path() / version);
    writer.add_tile({}, std::vector<maps::MapPoint>(1));
    std::vector<maps::StampedPose> poses(3);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      poses[i].stamp_ns = static_cast<std::int64_t>(i);
      poses[i].T_map_lidar.translation().x() = 0.5 * static_cast<double>(i);
    }
    writer.write_trajectory(maps::Trajectory(poses));
    if (graph) maps::write_map_graph(writer.folder(), *graph);
    maps::MapManifest manifest;
    manifest.frame_id = "local";
    manifest.options = options;
    manifest.options["version"] = version;
    writer.publish(manifest, "{}");
    store_.open().add("town", version, folder_.path() / version);
    const HttpResponse response = get("/v1/maps/town/versions/" + version + "/graph");
    EXPECT_EQ(response.status, 200);
    EXPECT_THAT(response.headers,
                ::testing::Contains(::testing::Pair("Cache-Control", HasSubstr("immutable"))));
    return body(response);
  }
};

TEST_F(Graph, IsTheOneOfTheBuild) {
  start();
  EXPECT_EQ(graph_of("v2", {{"odometry", "default"}},
                     maps::MapGraph{.key_frames = {0, 1}, .loops = {{2, 0, 0.75}}}),
            nlohmann::json::parse(R"({"source": "build", "key_frames": [0, 1],
                                      "loops": [{"from": 2, "to": 0, "weight": 0.75}]})"));
}

TEST_F(Graph, IsDerivedWhereTheVersionDoesNotSay) {
  start();
  EXPECT_EQ(graph_of("v2", {{"odometry", "given"}}, {}),
            nlohmann::json::parse(R"({"source": "derived", "key_frames": [0, 2], "loops": []})"));
  EXPECT_TRUE(graph_of("v3", {{"odometry", "loam"}}, {})["loops"].is_null())
      << "there may have been some";
  EXPECT_EQ(body(get("/v1/maps/town/versions/v9/graph"))["code"], "UnknownVersion");
}

}  // namespace version_facts_test
}  // namespace stillmap::server

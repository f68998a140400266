#include <gmock/gmock.h>

#include <fstream>
#include <string>
#include <vector>

#include "support/tiled_map.hpp"
#include "view_fixture.hpp"

namespace stillmap::server {
namespace difference_routes_test {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;
using ::testing::SizeIs;

constexpr const char* kDifference = "/v1/maps/city/versions/v2/difference/v1";

/// A `city` of v1, v2 registered to it, and v3 in a frame of its own.
class DifferenceRoutes : public ViewTest {
 protected:
  DifferenceRoutes() {
    const std::vector<maps::MapPoint> house = test::scattered(30.0);
    maps::MapManifest manifest;
    const std::string first = publish("v1", with(house, 5.0F, 5.0F), manifest);
    manifest.registration = maps::Registration{.previous_digest = first};
    second_ = publish("v2", with(house, -15.0F, 5.0F), manifest);
    manifest.registration.reset();
    publish("v3", house, manifest);
  }
  /// With a post that stands out.
  static std::vector<maps::MapPoint> with(std::vector<maps::MapPoint> points, float x, float y) {
    for (int i = 0; i < 10; ++i)
      points.push_back(test::map_point(x, y, 20.0F + static_cast<float>(i)));
    return points;
  }
  std::string publish(const std::string& version, const std::vector<maps::MapPoint>& points,
                      const maps::MapManifest& manifest) {
    const auto map = test::write_map(built_.path() / version, points, manifest);
    store_.open().add("city", version, built_.path() / version);
    return map->digest();
  }
  [[nodiscard]] HttpResponse asked(const std::string& path,
                                   const std::vector<std::pair<std::string, std::string>>& query) {
    HttpRequest each = request("GET", path);
    each.query = query;
    return service_->handle(each);
  }
  /// Asks until it is computed.
  [[nodiscard]] HttpResponse computed(
      const std::string& path, const std::vector<std::pair<std::string, std::string>>& query = {}) {
    while (true) {
      HttpResponse response = asked(path, query);
      if (response.status != 202) return response;
      EXPECT_EQ(body(response)["state"], "making");
      EXPECT_GE(body(response)["progress"], 0.0);
      EXPECT_THAT(response.headers, Contains(Pair("Retry-After", "1")));
      EXPECT_THAT(response.headers, Contains(Pair("Cache-Control", "no-store")));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  test::TemporaryFolder built_;
  std::string second_;
};

TEST_F(DifferenceRoutes, CountsWhatOnlyOneHasAndServesIt) {
  start();
  EXPECT_EQ(get(kDifference).status, 202);
  const HttpResponse response = computed(kDifference);
  ASSERT_EQ(response.status, 200);
  const auto json = body(response);
  EXPECT_EQ(json["state"], "ready");
  EXPECT_EQ(json["tolerance_m"], 0.15);
  EXPECT_EQ(json["only_in_version"]["points"], 10);
  EXPECT_EQ(json["only_in_version"]["kinds"]["measured"], 10);
  EXPECT_EQ(json["only_in_version"]["area_m2"], 1);
  EXPECT_EQ(json["only_in_other"]["points"], 10);
  ASSERT_THAT(json["tiles"], SizeIs(2));
  const auto& west = json["tiles"][0];
  EXPECT_EQ(west["x"], -1);
  EXPECT_TRUE(west["only_in_other"].is_null());
  EXPECT_THAT(
      west["only_in_version"]["min"].get<std::vector<double>>(),
      ElementsAre(DoubleNear(-15.0, test::kOffByStepsM), DoubleNear(5.0, test::kOffByStepsM),
                  DoubleNear(20.0, test::kOffByStepsM)));
  const std::string url = west["only_in_version"]["url"];
  EXPECT_EQ(url, std::string(kDifference) + "/version/-1/0.glb?tolerance_m=0.15");
  const HttpResponse tile = asked(url.substr(0, url.find('?')), {{"tolerance_m", "0.15"}});
  ASSERT_EQ(tile.status, 200);
  EXPECT_EQ(tile.content_type, "model/gltf-binary");
  EXPECT_TRUE(sent(tile).starts_with("glTF"));
  EXPECT_THAT(tile.headers, Contains(Pair("Cache-Control", HasSubstr("immutable"))));
  EXPECT_EQ(again(kDifference, header(response, "ETag")).status, 304);
  EXPECT_EQ(again(url.substr(0, url.find('?')), header(tile, "ETag")).status, 304);
}

TEST_F(DifferenceRoutes, TileOfADifferenceThatIsNotThereYetHasItMade) {
  start();
  const std::string tile = std::string(kDifference) + "/version/-1/0.glb";
  EXPECT_EQ(body(get(tile))["code"], "BeingMade");
  EXPECT_EQ(made(tile).status, 200);
}

TEST_F(DifferenceRoutes, OtherFrameIsRefusedInBothRoutes) {
  start();
  const std::string path = "/v1/maps/city/versions/v2/difference/v3";
  EXPECT_EQ(get(path).status, 409);
  EXPECT_EQ(body(get(path))["code"], "OtherFrame");
  EXPECT_EQ(body(get(path + "/other/0/0.glb"))["code"], "OtherFrame");
}

TEST_F(DifferenceRoutes, WhatIsNotThereIsUnknownAndWhatIsWrongIsSaid) {
  start();
  (void)computed(kDifference);
  const std::string base = kDifference;
  for (const auto& [path, code] : std::vector<std::pair<std::string, std::string>>{
           {base + "/version/7/0.glb", "UnknownTile"},
           {base + "/other/-1/0.glb", "UnknownTile"},
           {base + "/both/-1/0.glb", "UnknownTile"},
           {base + "/version/x/0.glb", "UnknownTile"},
           {"/v1/maps/city/versions/v2/difference/v9", "UnknownVersion"},
           {"/v1/maps/city/versions/v9/difference/v2", "UnknownVersion"},
           {"/v1/maps/village/versions/v2/difference/v1", "UnknownMap"}}) {
    EXPECT_EQ(body(get(path))["code"], code) << path;
  }
  for (const char* wrong : {"0", "0.001", "2.5", "-1", "nan", "inf", "", "0.1m", "1e400"}) {
    const HttpResponse response = asked(kDifference, {{"tolerance_m", wrong}});
    EXPECT_EQ(body(response)["code"], "InvalidRequest") << wrong;
  }
  EXPECT_EQ(body(asked(kDifference, {{"tolerance", "1"}}))["code"], "UnknownParameter");
  EXPECT_EQ(asked(kDifference, {{"tolerance_m", "1"}, {"tolerance_m", "1"}}).status, 400);
}

TEST_F(DifferenceRoutes, EachToleranceIsADifferenceOfItsOwn) {
  start();
  const auto wide = body(computed(kDifference, {{"tolerance_m", "1.5"}}));
  EXPECT_EQ(wide["tolerance_m"], 1.5);
  EXPECT_EQ(wide["only_in_version"]["points"], 10);
  EXPECT_EQ(body(computed(kDifference, {{"tolerance_m", "0.1504"}}))["tolerance_m"], 0.15);
}

TEST_F(DifferenceRoutes, VersionComparedWithItselfIsTheSame) {
  start();
  const auto json = body(computed("/v1/maps/city/versions/v3/difference/v3"));
  EXPECT_EQ(json["only_in_version"]["points"], 0);
  EXPECT_THAT(json["tiles"], SizeIs(0));
}

TEST_F(DifferenceRoutes, WhatCannotBeWrittenIsSaidInWords) {
  std::ofstream(store_.folder().path() / "packages" / second_ / "differences") << "in the way";
  start();
  const HttpResponse response = computed(kDifference);
  EXPECT_EQ(response.status, 503);
  EXPECT_EQ(body(response)["code"], "DerivedUnavailable");
}

/// It would be kept, and stay wrong when the other version is mended.
TEST_F(DifferenceRoutes, AreNotMadeAgainstADamagedVersion) {
  const fs::path package =
      store_.folder().path() / "packages" / store_.open().state().version("city", "v1").digest;
  const std::string pack = test::pack_of(package);
  {
    std::fstream file(package / pack, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(3);
    file.put('!');
  }
  start();
  const HttpResponse response = computed(kDifference);
  EXPECT_EQ(response.status, 503);
  EXPECT_EQ(body(response)["code"], "DerivedUnavailable");
  EXPECT_THAT(body(response)["detail"].get<std::string>(),
              HasSubstr(pack + ", tile 0, 0: found SHA-256"));
  EXPECT_FALSE(fs::exists(store_.folder().path() / "packages" / second_ / "differences"));
}

TEST_F(DifferenceRoutes, AreNotMadeWhereTheDiskWouldBeFull) {
  const ServedVersion v1{
      .map = "town", .version = "v1", .package = store_.open().open("town", "v1")};
  MapViews views(store_.folder().path(), std::numeric_limits<std::uint64_t>::max());
  const auto answer = [&] {
    try {
      const DifferenceState state = views.difference({v1, v1, 0.15});
      return std::string(state.ready ? "made" : "");
    } catch (const ApiError& error) {
      return std::string(error.what());
    }
  };
  std::string said = answer();
  for (; said.empty(); said = answer()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_THAT(said, ::testing::HasSubstr("of its disk are free"));
  EXPECT_TRUE(std::filesystem::is_empty(store_.package() / "differences"));
}

TEST_F(DifferenceRoutes, LeaveTheReserveOfTheDiskToo) {
  options_.quotas.disk_reserve_bytes = std::int64_t{1} << 50U;
  start();
  const HttpResponse response = computed(kDifference);
  EXPECT_EQ(response.status, 503) << response.body;
  EXPECT_EQ(body(response)["code"], "DerivedUnavailable");
}

TEST_F(DifferenceRoutes, DamagedOneIsMadeAnew) {
  start();
  (void)computed(kDifference);
  const std::string tile = std::string(kDifference) + "/version/-1/0.glb";
  const std::string whole = sent(made(tile));
  const fs::path folder = store_.folder().path() / "packages" / second_ / "differences";
  {
    std::fstream file(fs::directory_iterator(folder)->path(),
                      std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(300);  // in the points of the first tile
    file.put('!');
  }
  EXPECT_EQ(body(get(tile))["code"], "BeingMade");
  EXPECT_EQ(sent(made(tile)), whole);
}

}  // namespace difference_routes_test
}  // namespace stillmap::server

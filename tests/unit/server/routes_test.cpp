#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <latch>
#include <stdexcept>
#include <string>
#include <vector>

#include "body_in_memory.hpp"
#include "service_fixture.hpp"
#include "view_fixture.hpp"

namespace stillmap::server {
namespace routes_test {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::Pair;

class Routes : public ServiceTest {};

TEST_F(Routes, AliveIsSaidBeforeAnyMapIsLoaded) {
  std::latch release(1);
  start([&](const maps::MapPackage&, const localization::LocalizationOptions&) {
    release.wait();
    return Aligners{{"default", aligner_}};
  });
  for (const char* path : {"/livez", "/healthz"}) {
    EXPECT_EQ(get(path).status, 200);
    EXPECT_EQ(body(get(path))["status"], "alive");
  }
  EXPECT_EQ(get("/readyz").status, 503);
  EXPECT_THAT(body(get("/readyz"))["reasons"][0].get<std::string>(), HasSubstr("town"));
  EXPECT_EQ(get("/v1/maps/town/ready").status, 503);
  const HttpResponse early = service_->handle(good_request());
  EXPECT_EQ(early.status, 503);
  EXPECT_EQ(body(early)["code"], "MapLoading");
  EXPECT_THAT(early.headers, Contains(Pair("Retry-After", "1")));
  release.count_down();
  wait_until_loaded();
  EXPECT_EQ(get("/v1/maps/town/ready").status, 200);
  EXPECT_EQ(service_->handle(good_request()).status, 200);
}

TEST_F(Routes, MapThatCannotBeIndexedIsNamedAndLeavesTheServerReady) {
  start([](const maps::MapPackage&, const localization::LocalizationOptions&) -> Aligners {
    throw std::runtime_error("too few voxels");
  });
  wait_until_loaded();
  EXPECT_THAT(body(get("/readyz"))["reasons"][0].get<std::string>(), HasSubstr("too few voxels"));
  EXPECT_EQ(get("/v1/maps/town/ready").status, 503);
  EXPECT_EQ(body(get("/v1/maps"))["refused"][0]["name"], "town");
  const HttpResponse response = service_->handle(good_request());
  EXPECT_EQ(response.status, 503);
  EXPECT_EQ(body(response)["code"], "MapUnusable");
  EXPECT_THAT(body(response)["detail"].get<std::string>(), HasSubstr("too few voxels"));
  // Nothing that would be another time it is sent.
  const HttpResponse activated =
      service_->handle(request("POST", "/v1/maps/town/versions/v1/activate"));
  EXPECT_EQ(activated.status, 409);
  EXPECT_EQ(body(activated)["code"], "VersionUnusable");
  EXPECT_THAT(body(activated)["detail"].get<std::string>(), HasSubstr("too few voxels"));
}

TEST_F(Routes, StatusTellsTheLimits) {
  start();
  nlohmann::json status = body(get("/v1/status"));
  EXPECT_EQ(status["maps"], 1);
  EXPECT_EQ(status["limits"]["workers"], 1);
  EXPECT_EQ(status["limits"]["max_payload_bytes"], options_.max_payload_bytes);
  EXPECT_GE(status["uptime_s"], 0.0);
}

TEST_F(Routes, MapsAreListedWithTheirVersionAndCounts) {
  start();
  nlohmann::json list = body(get("/v1/maps"));
  ASSERT_EQ(list["maps"].size(), 1U);
  EXPECT_EQ(list["maps"][0]["name"], "town");
  EXPECT_EQ(list["maps"][0]["version"], store_.version());
  EXPECT_EQ(list["maps"][0]["digest"], store_.digest());
  EXPECT_EQ(list["maps"][0]["points"], 3);
  EXPECT_EQ(list["maps"][0]["tiles"], 2);
}

// Tile (0, 0) has points at (1, 2) and (4, 5), tile (-1, 0) a single one.
TEST_F(Routes, MapsTellTheirSizeAndAge) {
  start();
  const nlohmann::json map = body(get("/v1/maps"))["maps"][0];
  EXPECT_NEAR(map["area_m2"].get<double>(), 9.0, 0.01);
  EXPECT_EQ(map["bytes"], store_.open().state().version("town", "v1").bytes);
  EXPECT_EQ(map["version_created_ns"],
            std::to_string(store_.open().state().version("town", "v1").created_ns));
  EXPECT_EQ(map["drives"], nlohmann::json::array());
  const nlohmann::json one = body(get("/v1/maps/town"));
  for (const char* key : {"area_m2", "bytes", "version_created_ns", "points"})
    EXPECT_EQ(one[key], map[key]) << key;
}

TEST_F(Routes, MapTellsItsFrameTilesAndCounts) {
  start();
  nlohmann::json map = body(get("/v1/maps/town"));
  EXPECT_EQ(map["origin"], nlohmann::json::parse("[100.0, 200.0, 0.0]"));
  EXPECT_FALSE(map.contains("geodetic_origin"));
  EXPECT_EQ(map["tile_size_m"], 20.0);
  EXPECT_EQ(map["objects"], 1);
  EXPECT_EQ(map["poses"], 2);
  EXPECT_EQ(map["tiles"], 2);
  EXPECT_THAT(
      map["bounds"]["min"].get<std::vector<double>>(),
      ElementsAre(DoubleNear(-0.75, test::kOffByStepsM), DoubleNear(2.25, test::kOffByStepsM),
                  DoubleNear(3.0, test::kOffByStepsM)));
  EXPECT_THAT(
      map["bounds"]["max"].get<std::vector<double>>(),
      ElementsAre(DoubleNear(4.25, test::kOffByStepsM), DoubleNear(5.25, test::kOffByStepsM),
                  DoubleNear(6.0, test::kOffByStepsM)));
}

TEST_F(Routes, TilesAreListedPartByPart) {
  start();
  const auto ask = [&](decltype(HttpRequest::query) query) {
    HttpRequest asked = request("GET", "/v1/maps/town/versions/" + store_.version() + "/tiles");
    asked.query = std::move(query);
    return service_->handle(asked);
  };
  const nlohmann::json all = body(ask({}));
  ASSERT_EQ(all["tiles"].size(), 2U);
  EXPECT_TRUE(all["next"].is_null());
  EXPECT_EQ(all["tiles"][0]["x"], 0) << "the last one first";
  EXPECT_EQ(all["tiles"][0]["points"], 2);
  EXPECT_THAT(
      all["tiles"][0]["max"].get<std::vector<double>>(),
      ElementsAre(DoubleNear(4.25, test::kOffByStepsM), DoubleNear(5.25, test::kOffByStepsM),
                  DoubleNear(6.0, test::kOffByStepsM)));
  const nlohmann::json one = body(ask({{"limit", "1"}}));
  ASSERT_EQ(one["tiles"], nlohmann::json::array({all["tiles"][0]}));
  const nlohmann::json other = body(ask({{"limit", "1"}, {"before", one["next"].dump()}}));
  EXPECT_EQ(other["tiles"], nlohmann::json::array({all["tiles"][1]}));
  EXPECT_TRUE(other["next"].is_null());
  // Bounds count, relative to the origin: the tile begins at -20 m, its only point is at -0.75 m.
  EXPECT_EQ(body(ask({{"area", "-1.5,0,0.5,9"}}))["tiles"], other["tiles"]);
  EXPECT_EQ(body(ask({{"area", "-20,0,-2,9"}}))["tiles"], nlohmann::json::array());
  EXPECT_EQ(body(ask({{"area", "-1,2,2,3"}}))["tiles"], all["tiles"]);
  for (const char* area : {"1,2,3", "1,2,3,4,5", "3,0,1,9", "1,2,x,4", "1,nan,3,4", ""})
    EXPECT_EQ(ask({{"area", area}}).status, 400) << area;
  EXPECT_EQ(ask({{"limit", "1001"}}).status, 400);
  EXPECT_EQ(ask({{"before", "x"}}).status, 400);
  EXPECT_EQ(ask({{"places", "1"}}).status, 400);
}

/// However large the map is, an answer has as much as was asked for, and all come.
TEST(TileList, HasEachTileOnce) {
  const test::TemporaryFolder folder;
  maps::MapPackageWriter writer(folder.path() / "map");
  constexpr std::int32_t kTiles = 2501;
  for (std::int32_t x = 0; x < kTiles; ++x) {
    const maps::MapPoint point{20.0F * static_cast<float>(x) + 1.0F, 1.0F, 0.0F, 0.0F, 1,
                               maps::PointKind::kMeasured,           0};
    writer.add_tile({.level = 0, .x = x, .y = 0}, std::span(&point, 1));
  }
  writer.publish({}, "{}");
  const auto map = maps::MapPackage::open(folder.path() / "map");
  std::vector<std::int32_t> found;
  std::optional<std::int64_t> before;
  do {
    const TilePage page = list_tiles(*map, {}, 500, before);
    EXPECT_LE(page.tiles.size(), 500U);
    for (const maps::TileEntry& tile : page.tiles) found.push_back(tile.id.x);
    before = page.next;
  } while (before);
  ASSERT_EQ(found.size(), std::size_t{kTiles});
  for (std::int32_t i = 0; i < kTiles; ++i)
    EXPECT_EQ(found[static_cast<std::size_t>(i)], kTiles - 1 - i);
  EXPECT_TRUE(list_tiles(*map, {}, 500, 1).tiles.empty());
  EXPECT_EQ(list_tiles(*map, {}, 1, std::int64_t{1} << 60U).tiles[0].id.x, kTiles - 1);
}

TEST_F(Routes, TrajectoryHasExactStampsAsText) {
  start();
  const nlohmann::json answer =
      body(get("/v1/maps/town/versions/" + store_.version() + "/trajectory"));
  ASSERT_EQ(answer["poses"].size(), 2U);
  EXPECT_EQ(answer["poses"][1]["stamp_ns"], "1100000000");
  EXPECT_EQ(answer["poses"][1]["position"], nlohmann::json::parse("[0.5, 0.0, 0.0]"));
  EXPECT_EQ(answer["poses"][1]["quaternion"], nlohmann::json::parse("[0.0, 0.0, 0.0, 1.0]"));
}

TEST_F(Routes, ObjectsAreListed) {
  start();
  const nlohmann::json answer =
      body(get("/v1/maps/town/versions/" + store_.version() + "/objects"));
  ASSERT_EQ(answer["objects"].size(), 1U);
  EXPECT_EQ(answer["objects"][0]["class"], "car");
  EXPECT_EQ(answer["objects"][0]["scan"], 7);
  EXPECT_EQ(answer["objects"][0]["points_removed"], 12);
}

TEST_F(Routes, WhoHasAPartOfAVersionIsToldSoAndNothingIsRead) {
  start();
  for (const char* part : {"trajectory", "objects", "graph"}) {
    const std::string path = "/v1/maps/town/versions/" + store_.version() + "/" + part;
    const HttpResponse first = get(path);
    ASSERT_EQ(first.status, 200) << part;
    EXPECT_THAT(first.headers,
                Contains(Pair("Cache-Control", "private, max-age=31536000, immutable")));
    HttpRequest again = request("GET", path);
    for (const auto& [name, value] : first.headers)
      if (name == "ETag") again.headers["if-none-match"] = value;
    const fs::path trajectory = store_.package() / "trajectory.tum";
    const fs::path objects = store_.package() / "objects.json";
    for (const fs::path& file : {trajectory, objects}) fs::rename(file, file.string() + ".away");
    const HttpResponse known = service_->handle(again);
    EXPECT_EQ(known.status, 304) << part;
    EXPECT_EQ(known.body, "");
    again.headers["if-none-match"] = "\"another\"";
    EXPECT_EQ(service_->handle(again).status, 500) << part;
    for (const fs::path& file : {trajectory, objects}) fs::rename(file.string() + ".away", file);
  }
}

TEST_F(Routes, DamagedTileIsRefusedAndTheOthersAreServed) {
  const std::string base = "/v1/maps/town/versions/" + store_.version() + "/";
  {
    std::fstream file(store_.package() / test::pack_of(store_.package()),
                      std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(5);
    file.put('!');
  }
  start();
  for (const char* tile : {"tiles/0/0/0", "3dtiles/0/0/0.glb"}) {
    const HttpResponse response = get(base + tile);
    EXPECT_EQ(response.status, 500) << tile;
    EXPECT_EQ(body(response)["code"], "StorageError");
  }
  EXPECT_EQ(get(base + "tiles/0/-1/0").status, 200);
}

TEST_F(Routes, TileIsTheBytesOfItsPointsAndMayBeKeptForEver) {
  start();
  const std::string path = "/v1/maps/town/versions/" + store_.version() + "/tiles/0/0/0";
  const HttpResponse response = get(path);
  ASSERT_EQ(response.status, 200);
  ASSERT_EQ(response.body.size(), 2 * sizeof(maps::MapPoint));
  maps::MapPoint second;
  std::memcpy(&second, response.body.data() + sizeof(second), sizeof(second));
  EXPECT_NEAR(second.y, 5.25, test::kOffByStepsM);
  EXPECT_THAT(response.headers, Contains(Pair("Stillmap-Tile-Corner", "100, 200, 0")));
  EXPECT_THAT(response.headers, Contains(Pair("Cache-Control", HasSubstr("immutable"))));
  const HttpResponse west = get("/v1/maps/town/versions/" + store_.version() + "/tiles/0/-1/0");
  maps::MapPoint first;
  std::memcpy(&first, west.body.data(), sizeof(first));
  EXPECT_NEAR(first.x, 19.25, test::kOffByStepsM);
  EXPECT_THAT(west.headers, Contains(Pair("Stillmap-Tile-Corner", "80, 200, 0")));

  HttpRequest again = request("GET", path);
  for (const auto& [name, value] : response.headers) {
    if (name == "ETag") again.headers["if-none-match"] = value;
  }
  ASSERT_TRUE(again.headers.contains("if-none-match"));
  EXPECT_EQ(service_->handle(again).status, 304);
  EXPECT_EQ(service_->handle(again).body, "");
}

TEST_F(Routes, WhatIsNotThereIsNamedByItsOwnCode) {
  start();
  const std::string base = "/v1/maps/town/versions/";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"/v1/nothing", "UnknownRoute"},
      {"/v1/maps/", "UnknownRoute"},
      {"/../../etc/passwd", "UnknownRoute"},
      {"/v1/maps/village", "UnknownMap"},
      {"/v1/maps/village/ready", "UnknownMap"},
      {"/v1/maps/..", "UnknownMap"},
      {base + "0123456789ab/objects", "UnknownVersion"},
      {base + "0123456789ab/tiles/0/0/0", "UnknownVersion"},
      {base + store_.version() + "/tiles/0/7/0", "UnknownTile"},
      {base + store_.version() + "/tiles/0/00/0", "UnknownTile"},
      {base + store_.version() + "/tiles/0/x/0", "UnknownTile"},
      {base + store_.version() + "/tiles/0/99999999999/0", "UnknownTile"},
  };
  for (const auto& [path, code] : cases) {
    const HttpResponse response = get(path);
    EXPECT_EQ(response.status, 404) << path;
    EXPECT_EQ(response.content_type, "application/problem+json") << path;
    EXPECT_EQ(body(response)["code"], code) << path;
    EXPECT_EQ(body(response)["status"], 404) << path;
    EXPECT_EQ(body(response)["request_id"], "test-1") << path;
  }
}

TEST_F(Routes, WrongMethodSaysWhichIsRight) {
  start();
  const HttpResponse get_on_post = get("/v1/maps/town/localize");
  EXPECT_EQ(get_on_post.status, 405);
  EXPECT_EQ(body(get_on_post)["code"], "MethodNotAllowed");
  EXPECT_THAT(get_on_post.headers, Contains(Pair("Allow", "POST")));
  const HttpResponse delete_on_get = service_->handle(request("DELETE", "/v1/maps"));
  EXPECT_THAT(delete_on_get.headers, Contains(Pair("Allow", "GET, HEAD")));
}

TEST_F(Routes, MissingFileInThePackageIsAStorageErrorWithoutItsPath) {
  start();
  for (const auto& entry : std::filesystem::directory_iterator(store_.package())) {
    if (entry.is_regular_file()) std::filesystem::remove(entry.path());
  }
  const HttpResponse response = get("/v1/maps/town/versions/" + store_.version() + "/trajectory");
  EXPECT_EQ(response.status, 500);
  EXPECT_EQ(body(response)["code"], "StorageError");
  EXPECT_THAT(response.body, Not(HasSubstr(store_.folder().path().string())));
}

TEST_F(Routes, WhatTheDiskRefusesIsAStorageErrorBeforeTheBodyIsReadAndBehindIt) {
  start();
  const fs::path folder = store_.folder().path();
  HttpRequest cloud = request("PUT", "/v1/maps/town/versions/v2");
  cloud.headers["content-type"] = "application/ply";
  const std::string text =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nend_header\n1 2 3\n";
  BodyInMemory cloud_bytes(text);
  cloud.stream = &cloud_bytes;
  fs::create_directories(folder / "jobs");
  std::ofstream(folder / "jobs/uploads") << "in the way";
  HttpResponse response = service_->handle(cloud);
  EXPECT_EQ(response.status, 500);
  EXPECT_EQ(body(response)["code"], "StorageError") << response.body;
  EXPECT_THAT(response.body, Not(HasSubstr(folder.string())));

  HttpRequest part = request("PUT", "/v1/maps/town/drives/1/parts/1");
  BodyInMemory part_bytes(text);
  part.stream = &part_bytes;
  for (const char* name : {"state.db", "state.db-wal"})
    std::ofstream(folder / name) << std::string(8192, 'x');
  response = service_->handle(part);
  EXPECT_EQ(response.status, 500);
  EXPECT_EQ(body(response)["code"], "StorageError") << response.body;
  EXPECT_THAT(response.body, Not(HasSubstr(folder.string())));
}

TEST_F(Routes, PageIsServedFromTheListOnly) {
  const test::TemporaryFolder web;
  web.write("index.html", "<p>page");
  web.write("assets/index-1a2b.js", std::string(1000, 'c'));
  web.write("assets/deep/hidden.js", "no");
  web.write("notes.cmake", "no");
  std::filesystem::create_symlink("/etc/passwd", web.path() / "assets/link.js");
  start(
      [this](const maps::MapPackage&, const localization::LocalizationOptions&) {
        return Aligners{{"default", aligner_}};
      },
      read_web_assets(web.path()));
  EXPECT_EQ(sent(get("/")), "<p>page");
  EXPECT_EQ(get("/").content_type, "text/html; charset=utf-8");
  EXPECT_THAT(get("/").headers, Contains(Pair("Content-Security-Policy", "default-src 'self'")));
  EXPECT_EQ(get("/assets/index-1a2b.js").content_type, "text/javascript; charset=utf-8");
  EXPECT_THAT(get("/assets/index-1a2b.js").headers,
              Contains(Pair("Cache-Control", HasSubstr("immutable"))));
  EXPECT_EQ(sent(get("/assets/index-1a2b.js")), std::string(1000, 'c'));
  HttpRequest packed = request("GET", "/assets/index-1a2b.js");
  packed.headers["accept-encoding"] = "br, gzip";
  EXPECT_LT(sent(service_->handle(packed)).size(), 100U);
  EXPECT_THAT(service_->handle(packed).headers, Contains(Pair("Content-Encoding", "gzip")));
  for (const char* path : {"/index.html/..", "/assets/deep/hidden.js", "/notes.cmake",
                           "/assets/link.js", "/assets/../index.html", "//etc/passwd"}) {
    EXPECT_EQ(get(path).status, 404) << path;
  }
}

TEST_F(Routes, WithoutAPageTheRootSaysSo) {
  start();
  EXPECT_EQ(get("/").status, 200);
  EXPECT_THAT(get("/").body, HasSubstr("not built"));
}

}  // namespace routes_test
}  // namespace stillmap::server

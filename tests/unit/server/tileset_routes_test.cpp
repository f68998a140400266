#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <string>

#include "catalog/map_views.hpp"
#include "support/tiled_map.hpp"
#include "view_fixture.hpp"

namespace stillmap::server {
namespace tileset_routes_test {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::Pair;

/// `town`, and a `city` of some levels of detail in the version v1, active.
class TilesetRoutes : public ViewTest {
 protected:
  TilesetRoutes() {
    test::write_map(built_.path() / "city", test::scattered(130.0));
    store_.open().add("city", "v1", built_.path() / "city");
    city_ = maps::MapPackage::open(built_.path() / "city")->digest();
  }
  [[nodiscard]] fs::path city_folder() const { return store_.folder().path() / "packages" / city_; }
  static void collect(const nlohmann::json& node, std::set<std::string>& uris) {
    if (node.contains("content")) uris.insert(node["content"]["uri"].get<std::string>());
    for (const auto& child : node.value("children", nlohmann::json::array())) collect(child, uris);
  }

  const std::string base_ = "/v1/maps/city/versions/v1/";
  test::TemporaryFolder built_;
  std::string city_;
};

TEST_F(TilesetRoutes, EveryTileThatTheTilesetNamesIsThere) {
  start();
  const HttpResponse tileset = made(base_ + "3dtiles/tileset.json");
  ASSERT_EQ(tileset.status, 200);
  EXPECT_EQ(tileset.content_type, "application/json");
  std::set<std::string> uris;
  collect(body(tileset)["root"], uris);
  EXPECT_GT(uris.size(), 100U);
  for (const std::string& uri : uris) {
    const HttpResponse tile = get(base_ + "3dtiles/" + uri);
    ASSERT_EQ(tile.status, 200) << uri;
    EXPECT_EQ(tile.content_type, "model/gltf-binary");
    const std::string glb = sent(tile);
    EXPECT_TRUE(glb.starts_with("glTF")) << uri;
    // The same points as they lie are what the GLB ends with.
    const HttpResponse raw = get(base_ + "tiles/" + uri.substr(0, uri.size() - 4));
    ASSERT_EQ(raw.status, 200) << uri;
    EXPECT_TRUE(glb.ends_with(sent(raw))) << uri;
  }
}

TEST_F(TilesetRoutes, TilesMayBeKeptForEverAndTilesetsAreAskedForAnew) {
  start();
  const HttpResponse tileset = made(base_ + "3dtiles/tileset.json");
  EXPECT_THAT(tileset.headers, Contains(Pair("Cache-Control", "no-cache")));
  EXPECT_EQ(again(base_ + "3dtiles/tileset.json", header(tileset, "ETag")).status, 304);
  std::set<std::string> tags{header(tileset, "ETag")};
  for (const char* tile :
       {"3dtiles/0/0/0.glb", "3dtiles/1/0/0.glb", "tiles/1/0/0", "tiles/0/0/0"}) {
    const HttpResponse response = get(base_ + tile);
    ASSERT_EQ(response.status, 200) << tile;
    EXPECT_THAT(response.headers, Contains(Pair("Cache-Control", HasSubstr("immutable"))));
    EXPECT_TRUE(tags.insert(header(response, "ETag")).second) << tile;
    const HttpResponse known = again(base_ + tile, header(response, "ETag"));
    EXPECT_EQ(known.status, 304);
    EXPECT_EQ(sent(known), "");
  }
}

TEST_F(TilesetRoutes, PartOfATileIsThatPart) {
  start();
  const HttpResponse response = get("/v1/maps/town/versions/v1/3dtiles/0/0/0.glb");
  const std::string whole = sent(response);
  for (const std::size_t from :
       {std::size_t{0}, std::size_t{5}, whole.size() - 41, whole.size() - 40, whole.size() - 3}) {
    std::string part(whole.size() - from, '\0');
    response.source->read(from, part);
    EXPECT_EQ(part, whole.substr(from)) << from;
    response.source->read(from, std::span(part).first(1));
    EXPECT_EQ(part[0], whole[from]);
  }
}

TEST_F(TilesetRoutes, FinestTilesDoNotWaitForTheOthers) {
  std::ofstream(city_folder() / "levels") << "in the way";
  start();
  EXPECT_EQ(get(base_ + "3dtiles/0/0/0.glb").status, 200);
  EXPECT_EQ(get(base_ + "tiles/0/0/0").status, 200);
}

TEST_F(TilesetRoutes, WhatIsNotThereIsUnknown) {
  start();
  (void)made(base_ + "3dtiles/tileset.json");
  for (const char* place :
       {"0/99/0.glb", "1/99/0.glb", "20/0/0.glb", "21/0/0.glb", "4000000000/0/0.glb", "0/00/0.glb",
        "0/0/0.gltf", "0/0/.glb", "x/0/0.glb", "0/0/0.json", "1/0/0.json", "0/0", "0/0/0"}) {
    const HttpResponse response = get(base_ + "3dtiles/" + place);
    EXPECT_EQ(response.status, 404) << place;
  }
  for (const char* place : {"1/99/0", "21/0/0", "20/0/0"}) {
    const HttpResponse response = get(base_ + "tiles/" + place);
    EXPECT_EQ(response.status, 404) << place;
    EXPECT_EQ(body(response)["code"], "UnknownTile") << place;
  }
  EXPECT_EQ(body(get("/v1/maps/village/versions/v1/3dtiles/tileset.json"))["code"], "UnknownMap");
  EXPECT_EQ(body(get("/v1/maps/city/versions/v9/3dtiles/tileset.json"))["code"], "UnknownVersion");
}

TEST_F(TilesetRoutes, ActiveVersionIsPreparedWithoutBeingAsked) {
  store_.open().activate("city", "v1");
  start();
  while (!fs::exists(city_folder() / "levels" / "levels.tiles"))
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(get(base_ + "3dtiles/tileset.json").status, 200);
}

TEST_F(TilesetRoutes, WhatCannotBeMadeIsSaidInWordsAndTriedAgainLater) {
  std::ofstream(city_folder() / "levels") << "in the way";
  start();
  const HttpResponse response = made(base_ + "3dtiles/tileset.json");
  EXPECT_EQ(response.status, 503);
  EXPECT_EQ(body(response)["code"], "DerivedUnavailable");
  EXPECT_THAT(response.headers, Contains(Pair("Retry-After", "60")));
  EXPECT_THAT(body(response)["detail"].get<std::string>(), HasSubstr(city_ + "/levels: "));
  EXPECT_THAT(body(response)["detail"].get<std::string>(),
              Not(HasSubstr(store_.folder().path().string())));
  EXPECT_EQ(body(get(base_ + "tiles/1/0/0"))["code"], "DerivedUnavailable");
}

TEST_F(TilesetRoutes, DamagedFileIsMadeAnew) {
  const auto damage = [this](std::streamoff from_end) {
    std::fstream file(city_folder() / "levels" / "levels.tiles",
                      std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(from_end, from_end < 0 ? std::ios::end : std::ios::beg);
    file.put('!');
  };
  start();
  (void)made(base_ + "3dtiles/tileset.json");
  const std::string whole = sent(get(base_ + "3dtiles/1/0/0.glb"));
  const HttpResponse tiles = get(base_ + "3dtiles/tileset.json");
  // Points of some tile, found when it is asked for.
  for (std::streamoff at = 300; at < 60'000; at += 20) damage(at);
  std::set<std::string> uris;
  collect(body(tiles)["root"], uris);
  for (const std::string& uri : uris) EXPECT_EQ(made(base_ + "3dtiles/" + uri).status, 200);
  EXPECT_EQ(sent(get(base_ + "3dtiles/1/0/0.glb")), whole);
  // The table, found when it is opened.
  service_.reset();
  damage(-5);
  start();
  EXPECT_EQ(made(base_ + "3dtiles/tileset.json").body, tiles.body);
}

TEST_F(TilesetRoutes, ServerEndsWhileSomethingIsBeingMade) {
  start();
  (void)get(base_ + "3dtiles/tileset.json");
  service_.reset();
  EXPECT_FALSE(fs::exists(city_folder() / "levels" / ".levels.tiles.partial"));
}

}  // namespace tileset_routes_test
}  // namespace stillmap::server

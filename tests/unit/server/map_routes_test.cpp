#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <future>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

#include "service_fixture.hpp"
#include "support/stored_packages.hpp"

namespace stillmap::server {
namespace map_routes_test {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Pair;

class MapRoutes : public ServiceTest {
 protected:
  HttpResponse send(const std::string& method, const std::string& path) const {
    return service_->handle(request(method, path));
  }
  HttpResponse diff(const std::string& body) const {
    HttpRequest result = request("POST", "/v1/maps/town/tiles/diff");
    result.headers["content-type"] = "application/json";
    result.body = body;
    return service_->handle(result);
  }
  static std::vector<std::string> ids(const nlohmann::json& added) {
    std::vector<std::string> each;
    for (const auto& tile : added) each.push_back(tile["id"]);
    return each;
  }
};

TEST_F(MapRoutes, MapIsMadeOnceAndFoundAgain) {
  start();
  const HttpResponse made = send("PUT", "/v1/maps/yard");
  EXPECT_EQ(made.status, 201);
  EXPECT_THAT(made.headers, Contains(Pair("Location", "/v1/maps/yard")));
  EXPECT_THAT(made.headers, Contains(Pair("ETag", "\"0\"")));
  EXPECT_TRUE(body(made)["version"].is_null());
  EXPECT_EQ(send("PUT", "/v1/maps/yard").status, 200);
  EXPECT_EQ(get("/v1/maps/yard").status, 200);
}

TEST_F(MapRoutes, AnswersAreOfOneStateOfTheStoreThatAnotherProcessHasChanged) {
  std::promise<void> loaded;
  start([this, release = loaded.get_future().share()](const maps::MapPackage& package,
                                                      const localization::LocalizationOptions&) {
    if (package.digest() != store_.digest()) release.wait();
    return Aligners{{"default", aligner_}};
  });
  wait_until_loaded();
  const test::TemporaryFolder built(test::memory_folder());
  const std::string digest = test::write_package(built.path() / "new", 7);
  PackageStore beside(store_.folder().path());
  beside.add("town", "v2", built.path() / "new");
  EXPECT_THAT(get("/v1/maps/town").headers, Contains(Pair("ETag", "\"1\"")));
  beside.activate("town", "v2");
  const HttpResponse answer = get("/v1/maps/town");
  EXPECT_THAT(answer.headers, Contains(Pair("ETag", "\"2\"")));
  EXPECT_EQ(body(answer)["revision"], 2);
  EXPECT_EQ(body(answer)["version"], "v2");
  EXPECT_EQ(body(answer)["previous_version"], "v1");
  EXPECT_EQ(body(answer)["digest"], digest);
  EXPECT_EQ(body(answer)["state"], "loading");
  const nlohmann::json listed = body(get("/v1/maps"))["maps"][0];
  EXPECT_EQ(listed["revision"], 2);
  EXPECT_EQ(listed["version"], "v2");
  EXPECT_EQ(listed["state"], "loading");
  HttpRequest stale = request("POST", "/v1/maps/town/rollback");
  stale.headers["if-match"] = "\"1\"";
  EXPECT_EQ(service_->handle(stale).status, 412);
  EXPECT_EQ(service_->handle(good_request()).status, 200) << "the version before serves meanwhile";
  loaded.set_value();
}

TEST_F(MapRoutes, PartsOfAVersionAreNotToldFromDamagedFiles) {
  start();
  const std::string version = "/v1/maps/town/versions/v1";
  for (const char* part : {"/trajectory", "/objects", "/graph"})
    EXPECT_EQ(get(version + part).status, 200) << part;
  {
    std::fstream file(store_.package() / "trajectory.tum", std::ios::in | std::ios::out);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    const std::size_t at = text.find("0.5");
    ASSERT_NE(at, std::string::npos) << text;
    file.seekp(static_cast<std::streamoff>(at));
    file << "0.7";
  }
  for (const char* part : {"/trajectory", "/graph"}) {
    const HttpResponse refused = get(version + part);
    EXPECT_EQ(refused.status, 500) << part;
    EXPECT_EQ(body(refused)["code"], "StorageError") << part;
  }
}

TEST_F(MapRoutes, NamesThatCouldBePathsAreRefused) {
  start();
  for (const char* name : {"..", "A", "a b", "-a", ".a"}) {
    const HttpResponse response = send("PUT", std::string("/v1/maps/") + name);
    EXPECT_EQ(response.status, 400) << name;
    EXPECT_EQ(body(response)["code"], "InvalidRequest") << name;
  }
}

TEST_F(MapRoutes, ServedMapGoesOnlyWhenToldSo) {
  start();
  const HttpResponse refused = send("DELETE", "/v1/maps/town");
  EXPECT_EQ(refused.status, 409);
  EXPECT_EQ(body(refused)["code"], "VersionActive");
  HttpRequest told = request("DELETE", "/v1/maps/town");
  told.query = {{"active", "yes"}};
  EXPECT_EQ(service_->handle(told).status, 400);
  told.query = {{"activ", "true"}};
  EXPECT_EQ(body(service_->handle(told))["code"], "UnknownParameter");
  EXPECT_EQ(get("/v1/maps/town").status, 200);

  told.query = {{"active", "true"}};
  EXPECT_EQ(service_->handle(told).status, 204);
  EXPECT_EQ(get("/v1/maps/town").status, 404);
  EXPECT_EQ(body(service_->handle(told))["code"], "UnknownMap");
  // The catalogue follows the store a little later.
  while (body(get("/v1/status"))["maps"] != 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(service_->handle(good_request()).status, 404);
}

TEST_F(MapRoutes, MapWithoutVersionsGoesAtOnce) {
  start();
  EXPECT_EQ(send("PUT", "/v1/maps/yard").status, 201);
  EXPECT_EQ(send("DELETE", "/v1/maps/yard").status, 204);
  EXPECT_EQ(get("/v1/maps/yard").status, 404);
}

TEST_F(MapRoutes, TileWithoutAVersionLeadsToTheActiveOne) {
  start();
  const HttpResponse response = get("/v1/maps/town/tiles/0/-1/0");
  EXPECT_EQ(response.status, 307);
  EXPECT_THAT(response.headers,
              Contains(Pair("Location", "/v1/maps/town/versions/v1/tiles/0/-1/0")));
  EXPECT_THAT(response.headers, Contains(Pair("Cache-Control", "no-cache")));
  EXPECT_EQ(get("/v1/maps/town/versions/v1/tiles/0/-1/0").status, 200);
  for (const char* place : {"0/0/x", "0/00/0", "-1/0/0"})
    EXPECT_EQ(get(std::string("/v1/maps/town/tiles/") + place).status, 404) << place;
  EXPECT_EQ(body(get("/v1/maps/village/tiles/0/0/0"))["code"], "UnknownMap");
}

// The map's origin is (100, 200): tile (0, 0) covers x in [100, 120), tile (-1, 0) x in [80, 100).
TEST_F(MapRoutes, DiffHasTheTilesWhoseSquareMeetsTheCircle) {
  start();
  const nlohmann::json inside = body(diff(R"({"center": [110, 210], "radius_m": 9.9})"));
  EXPECT_EQ(inside["version"], "v1");
  EXPECT_EQ(ids(inside["add"]), std::vector<std::string>{"v1/0/0/0"});
  EXPECT_EQ(inside["add"][0]["points"], 2);
  EXPECT_EQ(inside["add"][0]["corner"], nlohmann::json({100.0, 200.0, 0.0}));
  EXPECT_EQ(inside["add"][0]["url"], "/v1/maps/town/versions/v1/tiles/0/0/0");
  EXPECT_EQ(get(inside["add"][0]["url"]).status, 200);
  const nlohmann::json both = body(diff(R"({"center": [110, 210], "radius_m": 10.1})"));
  EXPECT_EQ(ids(both["add"]), (std::vector<std::string>{"v1/0/-1/0", "v1/0/0/0"}));
  EXPECT_EQ(both["add"][0]["corner"], nlohmann::json({80.0, 200.0, 0.0}));
  // From beyond a corner it is the diagonal that counts.
  EXPECT_TRUE(body(diff(R"({"center": [123, 224], "radius_m": 4.9})"))["add"].empty());
  EXPECT_EQ(body(diff(R"({"center": [123, 224], "radius_m": 5.1})"))["add"].size(), 1U);
  EXPECT_TRUE(body(diff(R"({"center": [110, 210], "radius_m": 10, "level": 1})"))["add"].empty());
}

TEST_F(MapRoutes, DiffKeepsWhatIsCachedAndNamesWhatIsToGo) {
  start();
  const nlohmann::json answer = body(diff(
      R"({"center": [110, 210], "radius_m": 5,
          "cached_ids": ["v1/0/0/0", "v1/0/-1/0", "v0/0/0/0", "v1/0/-1/0", "nonsense"]})"));
  EXPECT_TRUE(answer["add"].empty());
  EXPECT_EQ(answer["remove"], (nlohmann::json{"v1/0/-1/0", "v0/0/0/0", "nonsense"}));
}

TEST_F(MapRoutes, DiffRefusesWhatIsOutOfBounds) {
  start();
  const std::vector<std::pair<std::string, std::string>> cases = {
      {R"({"radius_m": 5})", "InvalidRequest"},
      {R"({"center": [1, 2]})", "InvalidRequest"},
      {R"({"center": [1, 2, 3], "radius_m": 5})", "InvalidRequest"},
      {R"({"center": [1e300, 2], "radius_m": 5})", "InvalidRequest"},
      {R"({"center": [1, 2], "radius_m": 0})", "InvalidRequest"},
      {R"({"center": [1, 2], "radius_m": 1000.1})", "InvalidRequest"},
      {R"({"center": [1, 2], "radius_m": 5, "level": -1})", "InvalidRequest"},
      {R"({"center": [1, 2], "radius_m": 5, "level": 1.5})", "InvalidRequest"},
      {R"({"center": [1, 2], "radius_m": 5, "level": 4294967296})", "InvalidRequest"},
      {R"({"center": [1, 2], "radius_m": 5, "cached_ids": [1]})", "InvalidRequest"},
      {R"({"center": [1, 2], "radius_m": 5, "cached": []})", "UnknownParameter"},
      {R"([1])", "InvalidRequest"},
  };
  for (const auto& [text, code] : cases) {
    EXPECT_EQ(diff(text).status, 400) << text;
    EXPECT_EQ(body(diff(text))["code"], code) << text;
  }
  nlohmann::json many = {{"center", {1, 2}}, {"radius_m", 5}};
  many["cached_ids"] = std::vector<std::string>(20'001, "a");
  EXPECT_EQ(diff(many.dump()).status, 413);
  HttpRequest raw = request("POST", "/v1/maps/town/tiles/diff");
  raw.body = "{}";
  EXPECT_EQ(service_->handle(raw).status, 415);
}

TEST_F(MapRoutes, DiffTakesAllIdsThatItMayAndNoMoreValues) {
  start();
  nlohmann::json many = {{"center", {110, 210}}, {"radius_m", 5}};
  const std::string longest = std::string(63, 'v') + "/20/-2147483648/-2147483648";
  many["cached_ids"] = std::vector<std::string>(20'000, longest);
  const std::string text = many.dump(1);
  EXPECT_EQ(diff(text).status, 200);
  const std::vector<const Route*> routes = service_->routes();
  const auto route = std::find_if(routes.begin(), routes.end(), [](const Route* each) {
    return each->pattern == "/v1/maps/{map}/tiles/diff";
  });
  ASSERT_NE(route, routes.end());
  EXPECT_LE(text.size(), (*route)->max_body_bytes);
  EXPECT_LE((*route)->max_body_bytes, std::size_t{2} << 20U);
  // In few bytes, what would take twenty times as many.
  many["cached_ids"] = {std::vector<nlohmann::json>(50'000, nlohmann::json::array())};
  EXPECT_EQ(diff(many.dump()).status, 413);
}

TEST_F(MapRoutes, LongDiffsTakePlaces) {
  start();
  std::vector<HttpRequest> held;
  const auto admitted = [&](const std::string& bytes) -> std::optional<ErrorCode> {
    HttpRequest asked = request("POST", "/v1/maps/town/tiles/diff");
    asked.headers["content-length"] = bytes;
    try {
      static_cast<void>(service_->admit(asked));
      held.push_back(asked);
      return std::nullopt;
    } catch (const ApiError& error) {
      return error.code();
    }
  };
  for (int i = 0; i < 16; ++i) EXPECT_EQ(admitted("65537"), std::nullopt);
  EXPECT_EQ(admitted("65537"), ErrorCode::kBusy);
  EXPECT_EQ(admitted("65536"), std::nullopt) << "short ones always find room";
  held.clear();
  EXPECT_EQ(admitted("2097152"), std::nullopt);
}

TEST_F(MapRoutes, ACompressedDiffTakesAPlaceWhateverItsLength) {
  start();
  std::vector<HttpRequest> held(16, request("POST", "/v1/maps/town/tiles/diff"));
  for (HttpRequest& each : held) {
    each.headers["content-length"] = "20";
    each.headers["content-encoding"] = "gzip";
    static_cast<void>(service_->admit(each));
  }
  HttpRequest more = held.front();
  EXPECT_THROW(static_cast<void>(service_->admit(more)), ApiError);
}

TEST(SharedPlaces, OneKeyHoldsItsShare) {
  SharedPlaces places;
  std::vector<std::shared_ptr<void>> held;
  const auto taken = [&](const std::string& key, double share) {
    int count = 0;
    try {
      for (;; ++count) held.push_back(places.take(16, key, "requests", share));
    } catch (const ApiError& error) {
      EXPECT_EQ(error.code(), held.size() < 16 ? ErrorCode::kTooManyRequests : ErrorCode::kBusy);
    }
    return count;
  };
  EXPECT_EQ(taken("a", 0.25), 4);
  EXPECT_EQ(taken("b", 0.001), 1);
  EXPECT_EQ(taken("c", 0.5), 8);
  EXPECT_EQ(taken("d", 1.0), 3);
}

TEST_F(MapRoutes, StatsCountPosesByStatusAndRefusals) {
  start();
  const nlohmann::json before = body(get("/v1/maps/town/stats"));
  EXPECT_EQ(before["queries"], nlohmann::json::parse(R"({"ok": 0, "degraded": 0, "lost": 0})"));
  EXPECT_TRUE(before["last_query_ns"].is_null());
  EXPECT_TRUE(before["latency_ms"]["total"].is_null());
  EXPECT_EQ(service_->handle(good_request()).status, 200);
  aligner_->answer = [](const auto&) { return localization::AlignmentResult{}; };  // lost
  EXPECT_EQ(service_->handle(good_request()).status, 200);
  HttpRequest bad = good_request();
  bad.body = "abc";
  EXPECT_EQ(service_->handle(bad).status, 400);
  HttpRequest elsewhere = good_request();
  elsewhere.path = "/v1/maps/village/localize";
  EXPECT_EQ(service_->handle(elsewhere).status, 404);

  const nlohmann::json after = body(get("/v1/maps/town/stats"));
  EXPECT_EQ(after["queries"], nlohmann::json::parse(R"({"ok": 1, "degraded": 0, "lost": 1})"));
  EXPECT_EQ(after["refused"], 1);
  EXPECT_EQ(after["latency_ms"]["queries"], 2);
  EXPECT_GE(after["latency_ms"]["total"]["p95"], after["latency_ms"]["total"]["p50"]);
  EXPECT_GE(after["latency_ms"]["total"]["p50"], after["latency_ms"]["localizer"]["p50"]);
  EXPECT_TRUE(after["last_query_ns"].is_string());
  EXPECT_EQ(get("/v1/maps/village/stats").status, 404);
}

TEST_F(MapRoutes, StatsCountTheSessionsOfAMap) {
  start();
  HttpRequest open = request("POST", "/v1/sessions");
  open.headers["content-type"] = "application/json";
  open.body = R"({"map": "town"})";
  const HttpResponse opened = service_->handle(open);
  ASSERT_EQ(opened.status, 201);
  EXPECT_EQ(send("PUT", "/v1/maps/yard").status, 201);
  EXPECT_EQ(body(get("/v1/maps/town/stats"))["sessions"], 1);
  EXPECT_EQ(body(get("/v1/maps/yard/stats"))["sessions"], 0);
  EXPECT_EQ(send("DELETE", "/v1/sessions/" + body(opened)["id"].get<std::string>()).status, 204);
  EXPECT_EQ(body(get("/v1/maps/town/stats"))["sessions"], 0);
}

TEST_F(MapRoutes, VersionWithoutAPreviewSaysSo) {
  start();
  const HttpResponse response = get("/v1/maps/town/versions/v1/preview");
  EXPECT_EQ(response.status, 404);
  EXPECT_THAT(body(response)["detail"].get<std::string>(), HasSubstr("without a preview"));
}

TEST(MapStats, PercentilesAreOfTheNearestRankAndOfTheNewest) {
  MapStats stats;
  for (int ms = 1; ms <= 100; ++ms) stats.answered("a", "ok", ms, 10 * ms);
  MapStats::Figures figures = stats.figures("a");
  EXPECT_EQ(figures.timed, 100U);
  EXPECT_EQ(figures.localizer->p50_ms, 50.0);
  EXPECT_EQ(figures.localizer->p95_ms, 95.0);
  EXPECT_EQ(figures.total->p95_ms, 950.0);
  for (int i = 0; i < 1024; ++i) stats.answered("a", "lost", 7.0, 8.0);
  figures = stats.figures("a");
  EXPECT_EQ(figures.timed, 1024U);
  EXPECT_EQ(figures.localizer->p50_ms, 7.0);
  EXPECT_EQ(figures.localizer->p95_ms, 7.0);
  EXPECT_EQ(figures.ok, 100U);
  EXPECT_EQ(figures.lost, 1024U);
  stats.forget("a");
  EXPECT_EQ(stats.figures("a").ok, 0U);
  EXPECT_FALSE(stats.figures("a").last.has_value());
}

}  // namespace map_routes_test
}  // namespace stillmap::server

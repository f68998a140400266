// A version for some vehicles, as clients and operators meet it.
#include <gmock/gmock.h>

#include <chrono>
#include <thread>

#include "service_fixture.hpp"
#include "support/stored_packages.hpp"

namespace stillmap::server {
namespace rollout_routes_test {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr const char* kRollout = "/v1/maps/town/rollout";

/// `town` with v1 active, v2 in its frame, and v3 in another one.
class RolloutRoutes : public ServiceTest {
 protected:
  void SetUp() override {
    options_.queue = 4;
    add("v2", 2, maps::Registration{.previous_digest = store_.digest()});
    add("v3", 3, {});
    start([this](const maps::MapPackage& map, const localization::LocalizationOptions&) {
      while (hold_) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      return Aligners{{"default", map.digest() == store_.digest() ? aligner_ : of_others_}};
    });
    wait_until_loaded();
  }
  void TearDown() override { hold_ = false; }
  void add(const std::string& version, int seed, std::optional<maps::Registration> registration) {
    const auto package = built_.path() / version;
    test::write_package(package, seed, 100, std::move(registration));
    store_.open().add("town", version, package);
  }

  json ask(HttpRequest asked, int status = 200) const {
    const HttpResponse response = service_->handle(std::move(asked));
    EXPECT_EQ(response.status, status) << response.body;
    return response.body.empty() ? json() : body(response);
  }
  json shown(const std::string& path) const { return ask(request("GET", path)); }
  static HttpRequest json_request(const std::string& method, const std::string& path,
                                  const json& content) {
    HttpRequest result = request(method, path);
    result.headers["content-type"] = "application/json";
    result.body = content.dump();
    return result;
  }
  json put(const json& content, int status = 200) const {
    return ask(json_request("PUT", kRollout, content), status);
  }
  /// Begins it and waits until its version is loaded.
  void roll_out(const json& content) const {
    put(content);
    while (shown(kRollout)["version_state"] != "ready")
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  static HttpRequest scan_of(const std::string& vehicle) {
    HttpRequest result = good_request();
    if (!vehicle.empty()) result.query.emplace_back("vehicle", vehicle);
    return result;
  }
  std::string version_for(const std::string& vehicle) const {
    return ask(scan_of(vehicle))["map"]["version"];
  }
  static HttpRequest with_vehicle(HttpRequest asked, const std::string& vehicle) {
    asked.query.emplace_back("vehicle", vehicle);
    return asked;
  }
  json open_session(const json& content, int status = 201) const {
    return ask(json_request("POST", "/v1/sessions", content), status);
  }
  static HttpRequest session_scan(const json& session, int stamp) {
    HttpRequest result =
        request("POST", "/v1/sessions/" + session["id"].get<std::string>() + "/scans");
    result.headers["content-type"] = "application/octet-stream";
    result.query = {{"stamp_ns", std::to_string(stamp)}};
    result.body = raw_scan(60);
    return result;
  }
  static std::function<localization::AlignmentResult(const localization::Prior&)> lost() {
    return [](const auto&) { return localization::AlignmentResult{}; };
  }

  test::TemporaryFolder built_{test::memory_folder()};
  std::atomic<bool> hold_ = false;
  std::shared_ptr<StubAligner> of_others_ = std::make_shared<StubAligner>();
};

TEST_F(RolloutRoutes, AVehicleOfTheGroupGetsTheNewVersion) {
  EXPECT_EQ(shown(kRollout), (json{{"map", "town"}, {"state", "none"}}));
  roll_out({{"version", "v2"}, {"vehicles", {"depot-*"}}});
  EXPECT_EQ(version_for("depot-3"), "v2");
  EXPECT_EQ(version_for("truck"), "v1");
  EXPECT_EQ(version_for(""), "v1");
  HttpRequest named = scan_of("depot-3");
  named.path = "/v1/maps/town/versions/v1/localize";
  EXPECT_EQ(ask(named)["map"]["version"], "v1") << "a version that is named is what it gets";
  EXPECT_EQ(ask(with_vehicle(request("GET", "/v1/maps/town"), "depot-3"))["version"], "v2");
  EXPECT_EQ(shown("/v1/maps/town")["version"], "v1");
  const json found = shown(kRollout);
  EXPECT_EQ(found["state"], "running");
  EXPECT_EQ(found["active_version"], "v1");
  EXPECT_EQ(found["answers"]["rollout"], (json{{"ok", 1}, {"degraded", 0}, {"lost", 0}}));
  EXPECT_EQ(found["answers"]["others"]["ok"], 2) << "none that named its version";
  ask(request("DELETE", kRollout), 204);
  EXPECT_EQ(version_for("depot-3"), "v1");
}

TEST_F(RolloutRoutes, JsonMultipartAndBatchesHaveTheVehicleInTheQuery) {
  roll_out({{"version", "v2"}, {"share", 1.0}});
  json points = json::array();
  for (int i = 0; i < 60; ++i) points.push_back({1.0 + 0.01 * i, 2.0, 3.0});
  const json query = {{"points", points}};
  HttpRequest whole = json_request("POST", "/v1/maps/town/localize", query);
  EXPECT_EQ(ask(with_vehicle(whole, "a"))["map"]["version"], "v2");
  whole.query = {{"method", "default"}};
  ask(whole, 400);
  const HttpRequest batch =
      json_request("POST", "/v1/maps/town/localize/batch", {{"queries", {query}}});
  EXPECT_EQ(ask(with_vehicle(batch, "a"))["answers"][0]["answer"]["map"]["version"], "v2");
  EXPECT_EQ(ask(batch)["answers"][0]["answer"]["map"]["version"], "v1");
  EXPECT_THAT(ask(with_vehicle(with_vehicle(batch, "a"), "b"), 400)["detail"],
              HasSubstr("vehicle"));
  ask(with_vehicle(batch, std::string(65, 'a')), 400);
  ask(with_vehicle(batch, "l\xc3\xa4ngs"), 400);
}

TEST_F(RolloutRoutes, UntilItIsLoadedTheGroupGetsTheActiveVersion) {
  hold_ = true;
  EXPECT_EQ(put({{"version", "v2"}, {"share", 1.0}})["version_state"], "loading");
  EXPECT_EQ(version_for("a"), "v1");
  hold_ = false;
  while (shown(kRollout)["version_state"] != "ready")
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(version_for("a"), "v2");
}

TEST_F(RolloutRoutes, IsHaltedWhenItsAnswersAreLost) {
  of_others_->answer = lost();
  roll_out({{"version", "v2"}, {"vehicles", {"bad"}}, {"halt", {{"least_answers", 20}}}});
  for (int i = 0; i < 19; ++i) {
    EXPECT_EQ(version_for("bad"), "v2");
    EXPECT_EQ(version_for("good"), "v1");
  }
  version_for("good");
  EXPECT_EQ(shown(kRollout)["state"], "running");
  EXPECT_EQ(version_for("bad"), "v2") << "the answer that halts it";
  EXPECT_EQ(version_for("bad"), "v1") << "at once";
  const json found = shown(kRollout);
  EXPECT_EQ(found["state"], "halted");
  EXPECT_THAT(found["reason"], HasSubstr("20 of the 20 answers in the new version are lost"));
  EXPECT_EQ(found["answers"]["rollout"]["lost"], 20);
  EXPECT_TRUE(store_.open().rollouts().list().front().halted) << "also after a restart";
  const std::string metrics = service_->metrics().text();
  EXPECT_THAT(metrics, HasSubstr("stillmap_rollout_halted{map=\"town\"} 1"));
  EXPECT_THAT(metrics, HasSubstr("stillmap_rollout_answers_total{group=\"rollout\",map=\"town\","
                                 "status=\"lost\"} 20"));
  ask(request("DELETE", "/v1/maps/town/versions/v2"), 409);
  put({{"version", "v2"}, {"vehicles", {"bad"}}});
  EXPECT_EQ(version_for("bad"), "v2") << "begun anew";
  EXPECT_EQ(shown(kRollout)["answers"]["rollout"]["lost"], 1);
}

TEST_F(RolloutRoutes, GoesOnWhileItIsAsGoodAsTheOthers) {
  aligner_->answer = of_others_->answer = lost();
  roll_out({{"version", "v2"}, {"vehicles", {"a"}}, {"halt", {{"least_answers", 20}}}});
  for (int i = 0; i < 25; ++i) version_for("b");
  for (int i = 0; i < 25; ++i) version_for("a");
  EXPECT_EQ(shown(kRollout)["state"], "running") << "nobody finds a place just now";
}

TEST_F(RolloutRoutes, ActivatingItCompletesIt) {
  roll_out({{"version", "v2"}, {"share", 0.5}});
  EXPECT_THAT(service_->metrics().text(), HasSubstr("stillmap_rollout_share{map=\"town\"} 0.5"));
  ask(request("POST", "/v1/maps/town/versions/v2/activate"));
  while (shown(kRollout)["state"] != "none")
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(version_for("a"), "v2");
  EXPECT_THAT(service_->metrics().text(), HasSubstr("stillmap_rollout_share{map=\"town\"} 0\n"));
}

TEST_F(RolloutRoutes, SessionsOfTheGroupEndWithIt) {
  of_others_->answer = lost();
  roll_out({{"version", "v2"}, {"vehicles", {"a", "b"}}, {"halt", {{"least_answers", 20}}}});
  const json session = open_session({{"map", "town"}, {"label", "a"}});
  const json named = open_session({{"map", "town"}, {"label", "b"}, {"version", "v2"}});
  const json other = open_session({{"map", "town"}});
  EXPECT_EQ(session["map"]["version"], "v2");
  EXPECT_EQ(other["map"]["version"], "v1");
  for (int i = 1; i <= 20; ++i) ask(session_scan(session, i));
  EXPECT_EQ(shown(kRollout)["state"], "halted");
  EXPECT_THAT(ask(session_scan(session, 21), 404)["detail"], HasSubstr("open another one"));
  ask(session_scan(named, 1));
  ask(session_scan(other, 1));
  EXPECT_EQ(open_session({{"map", "town"}, {"label", "a"}})["map"]["version"], "v1");
}

TEST_F(RolloutRoutes, SessionsOfTheGroupGoOnWhenItIsCompleted) {
  roll_out({{"version", "v2"}, {"vehicles", {"a"}}});
  const json session = open_session({{"map", "town"}, {"label", "a"}});
  ask(session_scan(session, 1));
  ask(request("POST", "/v1/maps/town/versions/v2/activate"));
  while (shown(kRollout)["state"] != "none")
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  ask(session_scan(session, 2));
  ask(request("POST", "/v1/maps/town/rollback"));
  ask(session_scan(session, 3));
}

TEST_F(RolloutRoutes, OtherServersOfTheStoreFollow) {
  PackageStore store(store_.folder().path());
  MapCatalog other(store, [this](const maps::MapPackage&, const auto&) {
    return Aligners{{"default", aligner_}};
  });
  const auto wait_for = [&](const std::string& version) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (other.find_for("town", "a").version != version) {
      ASSERT_LT(std::chrono::steady_clock::now(), end);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  };
  roll_out({{"version", "v2"}, {"share", 1.0}});
  wait_for("v2");
  other.halt_rollout(*other.rollout("town"), "as the other server found");
  while (shown(kRollout)["state"] != "halted")
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(version_for("a"), "v1");
  roll_out({{"version", "v2"}, {"share", 1.0}});
  wait_for("v2");
  ask(request("DELETE", kRollout), 204);
  wait_for("v1");
}

TEST_F(RolloutRoutes, ItsVersionStaysLoaded) {
  roll_out({{"version", "v2"}, {"share", 1.0}});
  for (int n = 4; n <= 9; ++n) add("v" + std::to_string(n), n, {});
  // Twice what is kept open; the store is looked at once a second.
  for (int round = 0; round < 3; ++round) {
    for (int n = 4; n <= 9; ++n) shown("/v1/maps/town/versions/v" + std::to_string(n));
    std::this_thread::sleep_for(std::chrono::milliseconds(600));
  }
  EXPECT_EQ(shown("/v1/maps/town/versions")["versions"].size(), 9U);
  EXPECT_EQ(shown(kRollout)["version_state"], "ready");
}

TEST_F(RolloutRoutes, VehiclesAreListed) {
  roll_out({{"version", "v2"}, {"vehicles", {"b"}}});
  for (const char* vehicle : {"b", "a", "b"}) version_for(vehicle);
  ask(with_vehicle(request("GET", "/v1/maps/town"), "c"));
  const json found = shown("/v1/maps/town/vehicles");
  ASSERT_EQ(found["vehicles"].size(), 3U);
  EXPECT_EQ(found["vehicles"][1]["label"], "b");
  EXPECT_EQ(found["vehicles"][1]["version"], "v2");
  EXPECT_EQ(found["vehicles"][1]["answers"], (json{{"ok", 2}, {"degraded", 0}, {"lost", 0}}));
  EXPECT_EQ(found["vehicles"][2]["answers"]["ok"], 0);
  EXPECT_TRUE(found["next"].is_null());
  HttpRequest page = request("GET", "/v1/maps/town/vehicles");
  page.query = {{"limit", "2"}};
  EXPECT_EQ(ask(page)["next"], "b");
  page.query = {{"limit", "2"}, {"after", "b"}};
  EXPECT_EQ(ask(page)["vehicles"][0]["label"], "c");
  ask(request("GET", "/v1/maps/none/vehicles"), 404);
}

TEST_F(RolloutRoutes, WhatCannotBeRolledOutIsRefused) {
  EXPECT_EQ(put({{"version", "v3"}, {"share", 0.1}}, 409)["code"], "OtherFrame");
  EXPECT_EQ(put({{"version", "v1"}}, 409)["code"], "VersionActive");
  EXPECT_EQ(put({{"version", "v9"}}, 404)["code"], "UnknownVersion");
  for (const json& wrong :
       {json{{"share", 0.1}}, json{{"version", "v2"}, {"share", 1.5}},
        json{{"version", "v2"}, {"vehicles", {""}}}, json{{"version", "v2"}, {"vehicles", "a"}},
        json{{"version", "v2"}, {"halt", {{"least_answers", 0}}}},
        json{{"version", "v2"}, {"halt", {{"most_rise", "x"}}}}, json{{"version", "v2"}, {"x", 1}}})
    put(wrong, 400);
  EXPECT_EQ(shown(kRollout)["state"], "none");
}

}  // namespace rollout_routes_test
}  // namespace stillmap::server

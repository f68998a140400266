#include <gmock/gmock.h>

#include <atomic>
#include <latch>
#include <thread>

#include "errors/api_error.hpp"
#include "pose/session_table.hpp"
#include "service_fixture.hpp"

namespace stillmap::server {
namespace sessions_test {

using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Key;

class Sessions : public ServiceTest {
 protected:
  void SetUp() override {
    options_.queue = 4;
    options_.max_clock_skew_s = 2.0;
    start();
  }

  HttpResponse send(HttpRequest request) const { return service_->handle(std::move(request)); }
  json ask(HttpRequest request, int status = 200) const {
    const HttpResponse response = send(std::move(request));
    EXPECT_EQ(response.status, status) << response.body;
    return response.body.empty() ? json() : body(response);
  }
  static HttpRequest json_post(const std::string& path, const json& content) {
    HttpRequest result = request("POST", path);
    result.headers["content-type"] = "application/json";
    result.body = content.dump();
    return result;
  }
  static json prior_json() {
    json covariance = json::array();
    for (int i = 0; i < 36; ++i) covariance.push_back(i % 7 == 0 ? 0.01 : 0.0);
    return {{"position", {1.0, 2.0, 3.0}},
            {"quaternion", {0.0, 0.0, 0.0, 1.0}},
            {"covariance", covariance}};
  }
  /// @return its path.
  std::string open() const {
    const json session =
        ask(json_post("/v1/sessions", {{"map", "town"}, {"prior", prior_json()}}), 201);
    return "/v1/sessions/" + session["id"].get<std::string>();
  }
  static HttpRequest scan(const std::string& session, const std::string& stamp_ns) {
    HttpRequest result = request("POST", session + "/scans");
    result.headers["content-type"] = "application/octet-stream";
    result.query = {{"stamp_ns", stamp_ns}};
    result.body = raw_scan(60);
    return result;
  }
};

TEST_F(Sessions, FollowAVehicleFromItsPrior) {
  const std::string session = open();
  const json answer = ask(scan(session, "1000000000"));
  EXPECT_EQ(answer["status"], "ok");
  EXPECT_EQ(answer["searched_from"], "given");
  EXPECT_EQ("/v1/sessions/" + answer["session"].get<std::string>(), session);
  EXPECT_EQ(aligner_->last_prior.T_map_lidar.translation(), Eigen::Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(ask(scan(session, "1100000000"))["searched_from"], "velocity");
  const json shown = ask(request("GET", session));
  EXPECT_EQ(shown["scans"], 2);
  EXPECT_EQ(shown["stamp_ns"], "1100000000");
  EXPECT_EQ(shown["status"], "ok");
  EXPECT_EQ(shown["map"]["version"], store_.version());
}

TEST_F(Sessions, WithoutAPriorTheVehicleIsSearchedForEverywhere) {
  const json session = ask(json_post("/v1/sessions", {{"map", "town"}}), 201);
  const std::string path = "/v1/sessions/" + session["id"].get<std::string>();
  EXPECT_EQ(ask(scan(path, "1"))["searched_from"], "everywhere");
  EXPECT_FALSE(aligner_->had_prior);
}

TEST_F(Sessions, NamesAre128BitsAndTheLocationIsSaid) {
  const HttpResponse response = send(json_post("/v1/sessions", {{"map", "town"}}));
  const std::string id = body(response)["id"];
  EXPECT_EQ(id.size(), 32U);
  EXPECT_EQ(id.find_first_not_of("0123456789abcdef"), std::string::npos);
  EXPECT_THAT(response.headers,
              Contains(std::pair<std::string, std::string>("Location", "/v1/sessions/" + id)));
  EXPECT_NE(ask(json_post("/v1/sessions", {{"map", "town"}}), 201)["id"], id);
}

TEST_F(Sessions, OdometryIsUsed) {
  const std::string session = open();
  ask(scan(session, "1000000000"));
  HttpRequest next = scan(session, "2000000000");
  next.query.insert(next.query.end(), {{"odom_since_ns", "1000000000"},
                                       {"odom_t", "1,0,0"},
                                       {"odom_q", "0,0,0,1"},
                                       {"odom_sigma", "0.1,0.01"}});
  EXPECT_EQ(ask(next)["searched_from"], "odometry");
  EXPECT_NEAR(aligner_->last_prior.T_map_lidar.translation().x(), 2.0, 1e-9);
}

TEST_F(Sessions, PlanarCovariancesOfFloatsAreTakenEverywhere) {
  // As a planar localizer or odometry has them: x, y and yaw, of 32-bit floats.
  std::vector<double> planar(36, 0.0);
  planar[0] = planar[7] = 0.25;
  planar[35] = 0.0625;
  planar[1] = 0.1;
  planar[6] = static_cast<double>(0.1F);
  json prior = prior_json();
  prior["covariance"] = planar;
  const json session = ask(json_post("/v1/sessions", {{"map", "town"}, {"prior", prior}}), 201);
  const std::string path = "/v1/sessions/" + session["id"].get<std::string>();
  ask(scan(path, "1000000000"));
  ASSERT_TRUE(aligner_->last_prior.covariance);
  EXPECT_DOUBLE_EQ((*aligner_->last_prior.covariance)(2, 2), 4.0);

  const json step = {{"since_ns", "1000000000"},
                     {"position", {3.0, 0.0, 4.0}},
                     {"quaternion", {0.0, 0.0, 0.0, 1.0}},
                     {"covariance", planar}};
  HttpRequest next = request("POST", path + "/scans");
  next.headers["content-type"] = "multipart/form-data; boundary=b";
  const auto with = [&](const json& odometry) {
    next.body = "--b\r\nContent-Disposition: form-data; name=\"request\"\r\n\r\n" +
                json{{"stamp_ns", "2000000000"}, {"odometry", odometry}}.dump() +
                "\r\n--b\r\nContent-Disposition: form-data; name=\"scan\"\r\n"
                "Content-Type: application/octet-stream\r\n\r\n" +
                raw_scan(60) + "\r\n--b--\r\n";
    return next;
  };
  EXPECT_EQ(ask(with(step))["searched_from"], "odometry");
  // A step of 5 m: 0.1 m and a tenth of it, beside 1 m of the pose before.
  const Eigen::Matrix<double, 6, 6>& covariance = *aligner_->last_prior.covariance;
  EXPECT_GE(covariance(2, 2), 0.6 * 0.6);
  EXPECT_GE(covariance(3, 3), 0.05 * 0.05);
  EXPECT_EQ(covariance, covariance.transpose());

  ask(json_post(path + "/initialize", {{"prior", prior}}));
  json bad = step;
  bad["covariance"][14] = 0.0;
  bad["covariance"][2] = bad["covariance"][12] = 0.1;
  EXPECT_THAT(ask(with(bad), 422)["detail"].get<std::string>(),
              HasSubstr("odometry.covariance: found a matrix that is not positive definite"));
}

TEST_F(Sessions, UnusableOdometryIsNamed) {
  const std::string session = open();
  ask(scan(session, "1000000000"));
  const auto with = [&](const std::string& since, const std::string& t, const std::string& sigma) {
    HttpRequest next = scan(session, "2000000000");
    next.query.insert(
        next.query.end(),
        {{"odom_since_ns", since}, {"odom_t", t}, {"odom_q", "0,0,0,1"}, {"odom_sigma", sigma}});
    return next;
  };
  EXPECT_EQ(ask(with("2000000000", "1,0,0", "1,1"), 422)["code"], "InvalidOdometry");
  EXPECT_EQ(ask(with("1000000000", "1e6,0,0", "1,1"), 422)["code"], "InvalidOdometry");
  EXPECT_EQ(ask(with("1000000000", "1,0,0", "0,1"), 422)["code"], "InvalidOdometry");
  HttpRequest half = scan(session, "2000000000");
  half.query.emplace_back("odom_t", "1,0,0");
  EXPECT_THAT(ask(half, 400)["detail"].get<std::string>(), HasSubstr("odom_since_ns"));
}

TEST_F(Sessions, TellWhereTheVehicleWasLast) {
  const std::string session = open();
  const json before = ask(request("GET", session));
  EXPECT_TRUE(before["pose"].is_null());
  EXPECT_TRUE(before["covariance"].is_null());
  EXPECT_TRUE(before["reasons"].empty());
  ask(scan(session, "1000000000"));
  json shown = ask(request("GET", session));
  EXPECT_EQ(shown["pose"]["position"], (json{1.0, 2.0, 3.0}));
  EXPECT_EQ(shown["pose_stamp_ns"], "1000000000");
  ASSERT_EQ(shown["covariance"].size(), 36U);
  EXPECT_EQ(shown["covariance"][7], 1.0);
  EXPECT_EQ(shown["inlier_ratio"], 0.9);
  // A scan from before says nothing of now.
  ask(scan(session, "900000000"));
  EXPECT_EQ(ask(request("GET", session))["pose_stamp_ns"], "1000000000");
  ask(json_post(session + "/initialize", json::object()));
  EXPECT_TRUE(ask(request("GET", session))["pose"].is_null());
  // Lost, it keeps the place where it was seen last.
  ask(json_post(session + "/initialize", {{"prior", prior_json()}}));
  ask(scan(session, "2000000000"));
  aligner_->answer = [](const auto&) {
    localization::AlignmentResult lost;
    lost.reasons = {localization::Reason::kLowInlierRatio};
    return lost;
  };
  for (int i = 1; i <= 100; ++i) ask(scan(session, std::to_string(2 + i) + "000000000"));
  shown = ask(request("GET", session));
  EXPECT_EQ(shown["status"], "lost");
  EXPECT_FALSE(shown["reasons"].empty());
  EXPECT_FALSE(shown["pose"].is_null());
  EXPECT_LT(std::stoll(shown["pose_stamp_ns"].get<std::string>()),
            std::stoll(shown["stamp_ns"].get<std::string>()));
}

TEST_F(Sessions, LabelIsTheClientsOrMadeFromTheSecretWithoutTellingIt) {
  const json named = ask(json_post("/v1/sessions", {{"map", "town"}, {"label", "truck 7"}}), 201);
  EXPECT_EQ(named["label"], "truck 7");
  const json other = ask(json_post("/v1/sessions", {{"map", "town"}}), 201);
  const std::string label = other["label"];
  EXPECT_EQ(label.size(), 12U);
  EXPECT_EQ(other["id"].get<std::string>().find(label), std::string::npos);
  for (const json& wrong :
       {json(7), json(""), json("a\nb"), json(std::string(65, 'a')), json("\xc3\xa9")})
    EXPECT_EQ(ask(json_post("/v1/sessions", {{"map", "town"}, {"label", wrong}}), 400)["code"],
              "InvalidRequest");
  EXPECT_EQ(ask(json_post("/v1/sessions/" + named["id"].get<std::string>() + "/initialize",
                          {{"label", "x"}}),
                400)["code"],
            "UnknownParameter");
}

TEST_F(Sessions, WithoutKeysAllAreListedAndTheirMapChosen) {
  open();
  HttpRequest list = request("GET", "/v1/sessions");
  EXPECT_EQ(ask(list)["sessions"].size(), 1U);
  EXPECT_TRUE(ask(list)["sessions"][0].contains("id"));
  EXPECT_TRUE(ask(list)["sessions"][0]["key_id"].is_null());
  list.query = {{"map", "town"}};
  EXPECT_EQ(ask(list)["sessions"].size(), 1U);
  list.query = {{"map", "village"}};
  EXPECT_TRUE(ask(list)["sessions"].empty());
  list.query = {{"mop", "town"}};
  EXPECT_EQ(ask(list, 400)["code"], "UnknownParameter");
}

TEST_F(Sessions, OperatorsSeeAllVehiclesButNoSecrets) {
  const auto make_key = [&](const char* name, std::initializer_list<KeyScope> scopes) {
    KeyScopes set;
    for (const KeyScope scope : scopes) set.add(scope);
    return store_.open().keys().create(name, set, std::nullopt, 1);
  };
  const auto alice = make_key("alice", {KeyScope::kLocalize});
  const auto bob = make_key("bob", {KeyScope::kLocalize});
  const auto chief = make_key("chief", {KeyScope::kAdmin});
  const auto both = make_key("both", {KeyScope::kAdmin, KeyScope::kLocalize});
  const auto reader = make_key("reader", {KeyScope::kRead, KeyScope::kWrite});
  const auto with = [](HttpRequest request, const KeyTable::Created& key) {
    request.headers["authorization"] = "Bearer " + key.text;
    return request;
  };
  const auto open_as = [&](const KeyTable::Created& key) {
    return ask(with(json_post("/v1/sessions", {{"map", "town"}}), key), 201)["id"]
        .get<std::string>();
  };
  const auto list_as = [&](const KeyTable::Created& key) {
    return ask(with(request("GET", "/v1/sessions"), key))["sessions"];
  };
  const std::string of_alice = open_as(alice);
  const std::string of_both = open_as(both);
  ask(with(scan("/v1/sessions/" + of_alice, "1000000000"), alice));

  EXPECT_EQ(list_as(alice).size(), 1U);
  EXPECT_EQ(list_as(alice)[0]["id"], of_alice);
  EXPECT_TRUE(list_as(bob).empty());
  const json all = list_as(chief);
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all.dump().find(of_alice), std::string::npos);
  EXPECT_EQ(all.dump().find(of_both), std::string::npos);
  for (const json& each : all) {
    EXPECT_FALSE(each.contains("id"));
    EXPECT_TRUE(each["key_name"] == "alice" || each["key_name"] == "both");
    EXPECT_EQ(each["pose"].is_null(), each["key_name"] == "both");
  }
  for (const json& each : list_as(both))
    EXPECT_EQ(each.contains("id"), each["key_id"] == both.key.id);
  // What is seen cannot be used.
  EXPECT_EQ(ask(with(request("GET", "/v1/sessions/" + of_alice), both), 404)["code"],
            "UnknownSession");
  EXPECT_EQ(ask(with(request("GET", "/v1/sessions/" + of_alice), chief), 403)["code"], "Forbidden");
  EXPECT_EQ(ask(with(request("GET", "/v1/sessions"), reader), 403)["errors"][0]["expected"],
            "localize or admin");
  EXPECT_EQ(ask(request("GET", "/v1/sessions"), 401)["code"], "MissingKey");
}

TEST_F(Sessions, AScanNeedsItsTime) {
  HttpRequest timeless = scan(open(), "1");
  timeless.query.clear();
  EXPECT_THAT(ask(timeless, 400)["detail"].get<std::string>(), HasSubstr("stamp_ns"));
}

TEST_F(Sessions, WhatBelongsToQueriesIsRefusedByName) {
  const std::string session = open();
  HttpRequest request = scan(session, "1");
  request.query.emplace_back("prior_t", "1,2,3");
  EXPECT_EQ(ask(request, 400)["code"], "UnknownParameter");
  EXPECT_EQ(
      ask(json_post(session + "/scans", {{"points", json::array()}, {"stamp_ns", 1}}), 415)["code"],
      "UnsupportedMediaType");
}

TEST_F(Sessions, AMultipartScanBringsItsParameters) {
  const std::string session = open();
  HttpRequest request = scan(session, "1");
  request.query.clear();
  request.headers["content-type"] = "multipart/form-data; boundary=b";
  request.body =
      "--b\r\nContent-Disposition: form-data; name=\"request\"\r\n\r\n{\"stamp_ns\": \"77\"}\r\n"
      "--b\r\nContent-Disposition: form-data; name=\"scan\"\r\n\r\n" +
      raw_scan(60) + "\r\n--b--\r\n";
  EXPECT_EQ(ask(request)["stamp_ns"], "77");
}

TEST_F(Sessions, TheNewestScanIsServedAndTheOlderOneToldSo) {
  const std::string session = open();
  std::latch running(1);
  std::latch release(1);
  const auto calm = aligner_->answer;
  aligner_->answer = [&](const auto& prior) {
    running.count_down();
    release.wait();
    return calm(prior);
  };
  std::jthread first([&] { ask(scan(session, "1000000000")); });
  running.wait();
  int old_status = 0;
  std::jthread older([&] {
    // It may come after the newer one; then it is told the same.
    old_status = send(scan(session, "1100000000")).status;
  });
  json newest;
  std::jthread newer([&] { newest = ask(scan(session, "1200000000")); });
  older.join();
  EXPECT_EQ(old_status, 429);
  release.count_down();
  newer.join();
  EXPECT_EQ(newest["stamp_ns"], "1200000000");
}

TEST_F(Sessions, ASessionThatIsDeletedIsGone) {
  const std::string session = open();
  EXPECT_EQ(send(request("DELETE", session)).status, 204);
  EXPECT_EQ(ask(scan(session, "1"), 404)["code"], "UnknownSession");
  EXPECT_EQ(ask(request("DELETE", session), 404)["code"], "UnknownSession");
  EXPECT_TRUE(ask(request("GET", "/v1/sessions"))["sessions"].empty());
}

TEST_F(Sessions, ASessionOutlivesItsMap) {
  const std::string session = open();
  EXPECT_EQ(send(request("DELETE", "/v1/maps/town")).status, 409);
  HttpRequest removal = request("DELETE", "/v1/maps/town");
  removal.query = {{"active", "true"}};
  EXPECT_EQ(send(removal).status, 204);
  while (get("/v1/maps/town/ready").status != 404) std::this_thread::yield();
  EXPECT_EQ(ask(scan(session, "100"))["map"]["version"], TownStore::version());
  EXPECT_EQ(get(session).status, 200);
  EXPECT_TRUE(get(session + "/events").events->next(std::chrono::milliseconds(1)).has_value());
}

TEST_F(Sessions, EventsTellOfChangesAndEndWithTheSession) {
  const std::string session = open();
  ask(scan(session, "1000000000"));
  ask(scan(session, "1100000000"));
  const HttpResponse response = send(request("GET", session + "/events"));
  ASSERT_TRUE(response.events);
  const std::string first = response.events->next(std::chrono::milliseconds(0)).value();
  EXPECT_EQ(first,
            "id: 1\nevent: status\ndata: "
            "{\"status\":\"ok\",\"reasons\":[],\"stamp_ns\":\"1000000000\"}\n\n");
  send(request("DELETE", session));
  EXPECT_THAT(response.events->next(std::chrono::milliseconds(0)).value(),
              HasSubstr("event: closed\ndata: {\"reason\":\"deleted\"}"));
  EXPECT_FALSE(response.events->next(std::chrono::milliseconds(0)));
}

TEST_F(Sessions, AStreamGoesOnAfterItsLastEvent) {
  const std::string session = open();
  ask(scan(session, "1000000000"));
  HttpRequest again = request("GET", session + "/events");
  again.headers["last-event-id"] = "1";
  EXPECT_EQ(send(again).events->next(std::chrono::milliseconds(0)), "");
}

TEST_F(Sessions, InitializeMovesTheVehicle) {
  const std::string session = open();
  ask(scan(session, "1000000000"));
  json there = prior_json();
  there["position"] = {50.0, 2.0, 3.0};
  ask(json_post(session + "/initialize", {{"prior", there}}));
  EXPECT_EQ(ask(scan(session, "500000000"))["searched_from"], "given");
  EXPECT_DOUBLE_EQ(aligner_->last_prior.T_map_lidar.translation().x(), 50.0);
  ask(json_post(session + "/initialize", json::object()));
  EXPECT_EQ(ask(scan(session, "1200000000"))["searched_from"], "everywhere");
}

TEST_F(Sessions, APriorWithoutItsCovarianceIsRefused) {
  json prior = prior_json();
  prior.erase("covariance");
  EXPECT_EQ(ask(json_post("/v1/sessions", {{"map", "town"}, {"prior", prior}}), 422)["code"],
            "InvalidPrior");
}

TEST_F(Sessions, AnUnknownMapOrVersionOpensNone) {
  EXPECT_EQ(ask(json_post("/v1/sessions", {{"map", "village"}}), 404)["code"], "UnknownMap");
  EXPECT_EQ(
      ask(json_post("/v1/sessions", {{"map", "town"}, {"version", "0123456789ab"}}), 404)["code"],
      "UnknownVersion");
  EXPECT_EQ(ask(json_post("/v1/sessions", json::object()), 400)["code"], "InvalidRequest");
}

TEST_F(Sessions, AFixNeedsAMapThatKnowsWhereItLies) {
  const json fix = {{"latitude_deg", 48.0}, {"longitude_deg", 11.0}, {"sigma_m", 5.0}};
  EXPECT_EQ(ask(json_post("/v1/sessions", {{"map", "town"}, {"gnss", fix}}), 422)["code"],
            "NoGeodeticOrigin");
}

TEST_F(Sessions, AFixMovesTheVehicleAlsoOnceItsMapIsRemoved) {
  const test::TemporaryFolder built;
  maps::MapPackageWriter writer(built.path() / "map");
  writer.add_tile({}, std::vector<maps::MapPoint>(3));
  writer.write_trajectory(maps::Trajectory(std::vector<maps::StampedPose>{{.stamp_ns = 1}}));
  maps::MapManifest manifest;
  manifest.frame_id = "enu";
  manifest.geodetic_origin = maps::GeodeticOrigin{48.0, 11.0, 500.0};
  (void)writer.publish(manifest, "{}");
  store_.open().add("placed", "v1", built.path() / "map");
  store_.open().activate("placed", "v1");
  start();
  while (get("/v1/maps/placed/ready").status != 200) std::this_thread::yield();
  const json fix = {{"latitude_deg", 48.0}, {"longitude_deg", 11.0}, {"sigma_m", 5.0}};
  const json session = ask(json_post("/v1/sessions", {{"map", "placed"}, {"gnss", fix}}), 201);
  const json labelled =
      ask(json_post("/v1/sessions", {{"map", "placed"}, {"gnss", fix}, {"label", "truck"}}), 201);
  HttpRequest removal = request("DELETE", "/v1/maps/placed");
  removal.query = {{"active", "true"}};
  EXPECT_EQ(send(removal).status, 204);
  while (get("/v1/maps/placed/ready").status != 404) std::this_thread::yield();
  std::filesystem::remove_all(store_.folder().path() / "packages");
  const std::string path = "/v1/sessions/" + session["id"].get<std::string>();
  ask(json_post(path + "/initialize", {{"gnss", fix}}));
  EXPECT_EQ(ask(scan(path, "1"))["searched_from"], "given");
  // Also of a vehicle that a roll-out could give another version.
  EXPECT_EQ(ask(scan("/v1/sessions/" + labelled["id"].get<std::string>(), "1"))["searched_from"],
            "given");
}

TEST_F(Sessions, AClockThatIsSetBackIsFollowed) {
  const std::string session = open();
  ask(scan(session, "1000000000"));
  ask(scan(session, "3600000000000"));
  json answer;
  for (int i = 1; i <= 5; ++i)
    answer = ask(scan(session, std::to_string(1'000'000'000 + 100'000'000 * i)));
  EXPECT_THAT(answer["reasons"], Contains("clock_set_back"));
  const json shown = ask(request("GET", session));
  EXPECT_EQ(shown["stamp_ns"], "1500000000");
  EXPECT_EQ(shown["reasons"], answer["reasons"]);
  ask(scan(session, "1600000000"));
  EXPECT_EQ(ask(scan(session, "1500000000"))["reasons"], answer["reasons"]) << "sent once more";
  EXPECT_EQ(ask(request("GET", session))["stamp_ns"], "1600000000");
}

TEST_F(Sessions, AreBoundedInNumber) {
  options_.sessions.max = 2;
  start();
  open();
  open();
  const HttpResponse third = send(json_post("/v1/sessions", {{"map", "town"}}));
  EXPECT_EQ(third.status, 503);
  EXPECT_THAT(third.headers, Contains(Key("Retry-After")));
}

TEST_F(Sessions, AClockThatIsOffIsTold) {
  const std::string session = open();
  EXPECT_TRUE(ask(scan(session, "1000000000"))["warnings"].empty());
  const json answer = ask(scan(session, "1500000000000000000"));
  ASSERT_EQ(answer["warnings"].size(), 1U);
  EXPECT_EQ(answer["warnings"][0]["code"], "clock_skew");
  EXPECT_LT(answer["warnings"][0]["ahead_s"], 0.0);
}

class SessionTableTest : public ::testing::Test {
 protected:
  ServedVersion map() const {
    ServedVersion map{
        .map = "town", .version = "v1", .package = maps::MapPackage::open(store_.package())};
    map.aligners =
        std::make_shared<const Aligners>(Aligners{{"default", std::make_shared<StubAligner>()}});
    return map;
  }

  TownStore store_;
  AlignmentQueue queue_{{}};
  Session::Clock::time_point now_ = Session::Clock::now();
};

TEST_F(SessionTableTest, SessionsEndWhenTheyAreNotUsed) {
  std::atomic<int> passed_s = 0;
  const auto start = Session::Clock::now();
  SessionTable table({.most = 4, .idle = std::chrono::seconds(10)}, queue_,
                     [&] { return start + std::chrono::seconds(passed_s); });
  const std::string used = table.open(map(), {.owner = ""})->id();
  const std::shared_ptr<Session> idle = table.open(map(), {.owner = ""});
  passed_s = 8;
  EXPECT_NO_THROW((void)table.find(used, ""));
  passed_s = 11;
  EXPECT_THROW((void)table.find(idle->id(), ""), ApiError);
  table.expire();
  EXPECT_EQ(table.size(), 1U);
  EXPECT_TRUE(idle->events().after(0, std::chrono::milliseconds(0)).closed);
  EXPECT_NO_THROW((void)table.find(used, ""));
}

TEST_F(SessionTableTest, OnlyTheKeyThatOpenedOneFindsIt) {
  SessionTable table({}, queue_);
  const std::string id = table.open(map(), {.owner = "alice"})->id();
  EXPECT_THROW((void)table.find(id, "bob"), ApiError);
  EXPECT_THROW((void)table.find(id, ""), ApiError);
  EXPECT_THROW(table.close(id, "bob"), ApiError);
  EXPECT_TRUE(table.list("bob").empty());
  EXPECT_EQ(table.list("alice").size(), 1U);
}

TEST_F(SessionTableTest, AKeyHoldsNoMoreThanItsShare) {
  SessionTable table({.most = 4, .client_share = 0.5}, queue_);
  table.open(map(), {.owner = "alice"});
  table.open(map(), {.owner = "alice"});
  try {
    table.open(map(), {.owner = "alice"});
    FAIL() << "was opened";
  } catch (const ApiError& error) {
    EXPECT_EQ(error.code(), ErrorCode::kTooManyRequests);
  }
  EXPECT_NO_THROW(table.open(map(), {.owner = "bob"}));
}

TEST_F(SessionTableTest, AnotherVersionOfTheMapBecomesAnEventOnce) {
  SessionTable table({}, queue_);
  const std::shared_ptr<Session> session = table.open(map(), {.owner = ""});
  session->note_active_version("town", session->map().version);
  EXPECT_TRUE(session->events().after(0, std::chrono::milliseconds(0)).events.empty());
  session->note_active_version("town", "0123456789ab");
  session->note_active_version("town", "0123456789ab");
  const auto read = session->events().after(0, std::chrono::milliseconds(0));
  ASSERT_EQ(read.events.size(), 1U);
  EXPECT_EQ(read.events[0].type, "version_activated");
  EXPECT_EQ(read.events[0].data, R"({"map":"town","version":"0123456789ab"})");
}

}  // namespace sessions_test
}  // namespace stillmap::server

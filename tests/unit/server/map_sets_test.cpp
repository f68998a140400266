#include <gmock/gmock.h>

#include <map>
#include <thread>

#include "service_fixture.hpp"

namespace stillmap::server {
namespace map_sets_test {

using nlohmann::json;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;

localization::AlignmentResult found_at(const Eigen::Isometry3d& T_map_lidar) {
  localization::AlignmentResult result;
  result.status = localization::PoseStatus::kOk;
  result.T_map_lidar = T_map_lidar;
  result.covariance = 1e-4 * Eigen::Matrix<double, 6, 6>::Identity();
  result.inlier_ratio = 0.9;
  return result;
}

Eigen::Isometry3d at(double x, double y = 0.0) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(x, y, 0.0);
  return T;
}

/// `west` was driven from x = 0 to 100, `east` from 80 to 200 of the set `street`, whose frame is
/// that of `west`. The frame of `east` lies at (1000, 0). Each answers as its stub says.
class MapSets : public ServiceTest {
 protected:
  static constexpr double kEastM = 1000.0;

  void SetUp() override {
    options_.queue = 8;
    add("west", 0.0, 100.0);
    // Of this place, so that maps lie beside each other on the Earth, too.
    add("east", 80.0 - kEastM, 200.0 - kEastM, "v1", 0.00898315);
    start([this](const maps::MapPackage& map, const localization::LocalizationOptions&) {
      return Aligners{{"default", aligners_.at(map.manifest().frame_id)}};
    });
    while (get("/readyz").status != 200) std::this_thread::yield();
    ASSERT_EQ(put("street", street()).status, 201);
  }

  void add(const std::string& name, double from_m, double to_m, const std::string& version = "v1",
           std::optional<double> longitude_deg = 0.0) {
    const test::TemporaryFolder built;
    maps::MapPackageWriter writer(built.path() / "map");
    for (int x = static_cast<int>(from_m / 20.0) - 1; x <= static_cast<int>(to_m / 20.0); ++x)
      writer.add_tile({.level = 0, .x = x, .y = 0}, std::vector<maps::MapPoint>(3));
    std::vector<maps::StampedPose> poses;
    for (double x = from_m; x <= to_m; x += 1.0)
      poses.push_back({.stamp_ns = static_cast<std::int64_t>(poses.size()), .T_map_lidar = at(x)});
    writer.write_trajectory(maps::Trajectory(poses));
    maps::MapManifest manifest;
    manifest.frame_id = name;
    if (longitude_deg) manifest.geodetic_origin = maps::GeodeticOrigin{0.0, *longitude_deg, 0.0};
    (void)writer.publish(manifest, "{}");
    store_.open().add(name, version, built.path() / "map");
    if (version == "v1") store_.open().activate(name, version);
  }

  static json set_of(const std::vector<json>& members) { return json{{"maps", members}}; }
  static json street() {
    return set_of({json{{"map", "west"}},
                   json{{"map", "east"}, {"position", json::array({kEastM, 0.0, 0.0})}}});
  }
  HttpResponse send(const std::string& method, const std::string& path, const json& of = {}) const {
    HttpRequest sent = request(method, path);
    if (!of.is_null()) {
      sent.headers["content-type"] = "application/json";
      sent.body = of.dump();
    }
    return service_->handle(sent);
  }
  HttpResponse put(const std::string& set, const json& of) const {
    return send("PUT", "/v1/sets/" + set, of);
  }
  static HttpRequest scan(const std::string& path, std::int64_t stamp_ns = 1) {
    HttpRequest result = request("POST", path);
    result.headers["content-type"] = "application/octet-stream";
    result.query = {{"stamp_ns", std::to_string(stamp_ns)}};
    result.body = raw_scan(60);
    return result;
  }
  static HttpRequest with_prior(HttpRequest scan, double x, const std::string& sigma = "0.5,0.05") {
    scan.query.emplace_back("prior_t", std::to_string(x) + ",0,0");
    scan.query.emplace_back("prior_q", "0,0,0,1");
    scan.query.emplace_back("prior_sigma", sigma);
    return scan;
  }
  json ask(const HttpRequest& request, int status = 200) {
    const HttpResponse response = service_->handle(request);
    EXPECT_EQ(response.status, status) << response.body;
    for (const auto& [name, value] : response.headers)
      if (name == "Stillmap-Seal") seal_ = value;
    return body(response);
  }
  /// The next scan of the sealed session.
  json follow(double seconds, const std::string& path = "/v1/localize/next") {
    HttpRequest next = scan(path, static_cast<std::int64_t>(1e9 * seconds) + 1);
    next.headers["stillmap-seal"] = seal_;
    return ask(next);
  }
  static std::vector<std::string> warnings(const json& answer) {
    std::vector<std::string> codes;
    for (const json& each : answer["warnings"]) codes.push_back(each["code"]);
    return codes;
  }
  static double x_in_set(const json& answer) {
    return answer["T_set_lidar"]["position"][0].get<double>();
  }
  /// A map shows the scan at a place of the set, or, without one, not at all.
  void show(const std::string& map, std::optional<double> x, double inlier_ratio = 0.9,
            std::vector<localization::Reason> reasons = {}) {
    localization::AlignmentResult result;
    if (x) result = found_at(at(map == "east" ? *x - kEastM : *x));
    result.inlier_ratio = inlier_ratio;
    if (!reasons.empty()) result.status = localization::PoseStatus::kDegraded;
    result.reasons = std::move(reasons);
    aligners_[map]->answer = [result](const auto&) { return result; };
  }
  /// Both show the vehicle where it is, at `x_` of the set.
  void show_vehicle() {
    aligners_["west"]->answer = [this](const auto&) { return found_at(at(x_)); };
    aligners_["east"]->answer = [this](const auto&) { return found_at(at(x_ - kEastM)); };
  }

  std::map<std::string, std::shared_ptr<StubAligner>> aligners_ = {
      {"west", std::make_shared<StubAligner>()},
      {"east", std::make_shared<StubAligner>()},
      {"depot", std::make_shared<StubAligner>()},
      {"map", std::make_shared<StubAligner>()}};
  std::string seal_;
  double x_ = 0.0;
};

TEST_F(MapSets, AreKeptShownAndRemoved) {
  EXPECT_EQ(put("street", street()).status, 200);
  EXPECT_EQ(body(get("/v1/sets"))["sets"].size(), 1U);
  const json street = body(get("/v1/sets/street"));
  EXPECT_EQ(street["maps"][0]["map"], "east");
  EXPECT_EQ(street["maps"][0]["position"], json::array({kEastM, 0.0, 0.0}));
  HttpRequest remove = request("DELETE", "/v1/maps/west");
  remove.query = {{"active", "true"}};
  EXPECT_EQ(body(service_->handle(remove))["code"], "InUse");
  EXPECT_EQ(send("DELETE", "/v1/sets/street").status, 204);
  EXPECT_EQ(body(send("DELETE", "/v1/sets/street"))["code"], "UnknownSet");
  EXPECT_EQ(body(get("/v1/sets/street"))["code"], "UnknownSet");
  EXPECT_EQ(service_->handle(remove).status, 204);
  const auto records = store_.open().audit().list(10, {});
  EXPECT_EQ(records.records.front().route, "/v1/maps/{map}");
}

TEST_F(MapSets, AreRefusedWhereTheyAreWrong) {
  const auto refusal = [&](const json& of) { return body(put("bad", of))["code"]; };
  const json west = {{"map", "west"}};
  json turned = west, more = west;
  turned["quaternion"] = {0, 0, 0, 2};
  more["pose"] = 1;
  EXPECT_EQ(refusal(set_of({})), "InvalidRequest");
  EXPECT_EQ(refusal(set_of({json{{"map", "nowhere"}}})), "UnknownMap");
  EXPECT_EQ(refusal(set_of({west, west})), "InvalidRequest");
  EXPECT_EQ(refusal(set_of({turned})), "InvalidTransform");
  EXPECT_EQ(refusal(set_of({more})), "UnknownParameter");
  EXPECT_EQ(body(put("Bad", street()))["code"], "InvalidRequest");
  EXPECT_THAT(body(get("/v1/sets"))["sets"], ::testing::SizeIs(1));
}

TEST_F(MapSets, PriorChoosesTheMapThatWasDrivenNearestToIt) {
  for (const auto& [x, name] : std::map<double, std::string>{{20.0, "west"}, {150.0, "east"}}) {
    const json answer = ask(with_prior(scan("/v1/localize"), x));
    EXPECT_EQ(answer["map"]["name"], name);
    EXPECT_EQ(answer["set"], "street");
    EXPECT_NEAR(x_in_set(answer), x, 1e-9);
    EXPECT_NEAR(answer["pose"]["position"][0].get<double>(), name == "east" ? x - kEastM : x, 1e-9);
    EXPECT_NEAR(answer["prior_to_pose"]["m"].get<double>(), 0.0, 1e-9);
  }
  // In the overlap the other one is asked where the first one has no pose.
  aligners_["west"]->answer = [](const auto&) { return localization::AlignmentResult{}; };
  EXPECT_EQ(ask(with_prior(scan("/v1/localize"), 90.0))["map"]["name"], "east");
  HttpRequest named = with_prior(scan("/v1/localize"), 90.0);
  named.query.emplace_back("set", "street");
  EXPECT_EQ(ask(named)["map"]["name"], "east");
  named.query.back().second = "other";
  EXPECT_EQ(ask(named, 404)["code"], "UnknownSet");
  EXPECT_EQ(ask(with_prior(scan("/v1/maps/west/localize"), 9.0))["status"], "lost");
  HttpRequest of_map = scan("/v1/maps/west/localize");
  of_map.query.emplace_back("set", "street");
  EXPECT_EQ(ask(of_map, 400)["code"], "UnknownParameter");
}

TEST_F(MapSets, FixChoosesAmongAllMapsWhereNoSetIsNamed) {
  ASSERT_EQ(put("other", street()).status, 201);
  HttpRequest fix = scan("/v1/localize");
  EXPECT_EQ(ask(fix, 400)["code"], "InvalidRequest");
  // 150 m east of the origin of `west`.
  fix.query.emplace_back("gnss", "0,0.00134747,,2");
  const json answer = ask(fix);
  EXPECT_EQ(answer["map"]["name"], "east");
  EXPECT_FALSE(answer.contains("T_set_lidar"));
  EXPECT_NEAR(answer["pose"]["position"][0].get<double>(), 150.0 - kEastM, 0.5);
}

TEST_F(MapSets, TwoMapsThatShowTheScanAtTwoPlacesGiveNoConfidentPose) {
  aligners_["west"]->answer = [](const auto&) { return found_at(at(50.0)); };
  aligners_["east"]->answer = [](const auto&) { return found_at(at(150.0 - kEastM)); };
  const json answer = ask(scan("/v1/localize"));
  EXPECT_EQ(answer["status"], "degraded");
  EXPECT_THAT(answer["reasons"], ElementsAre("ambiguous"));
  EXPECT_TRUE(answer["protection"]["lateral_m"].is_null());
  // At one place they agree.
  aligners_["east"]->answer = [](const auto&) { return found_at(at(50.2 - kEastM)); };
  EXPECT_EQ(ask(scan("/v1/localize"))["status"], "ok");
  // A session is not confirmed in either as long as both do.
  aligners_["east"]->answer = [](const auto&) { return found_at(at(150.0 - kEastM)); };
  EXPECT_THAT(ask(scan("/v1/localize/next"))["reasons"], Contains("ambiguous"));
  for (int i = 1; i < 4; ++i) EXPECT_NE(follow(0.1 * i)["status"], "ok");
  aligners_["east"]->answer = [](const auto&) { return localization::AlignmentResult{}; };
  EXPECT_THAT(follow(0.5)["reasons"], ElementsAre("unconfirmed"));
  EXPECT_EQ(follow(0.6)["status"], "ok");
}

TEST_F(MapSets, MapThatShowsTheScanAlmostAsWellIsNoLessARival) {
  using localization::Reason;
  show("west", 50.0, 0.80);
  show("east", 150.0, 0.73, {Reason::kLowInlierRatio});
  EXPECT_THAT(ask(scan("/v1/localize"))["reasons"], ElementsAre("ambiguous"));
  show("east", 150.0, 0.70, {Reason::kLowInlierRatio});
  EXPECT_EQ(ask(scan("/v1/localize"))["status"], "ok");
  show("east", 150.0, 0.79, {Reason::kContradictsPrior});
  EXPECT_EQ(ask(scan("/v1/localize"))["status"], "ok");
}

TEST_F(MapSets, TwoFloorsWithinThePriorGiveNoConfidentPose) {
  // Driven by both, and three metres from one another.
  show("west", 90.0);
  show("east", 93.0);
  EXPECT_THAT(ask(with_prior(scan("/v1/localize"), 91.0))["reasons"], ElementsAre("ambiguous"));
  EXPECT_EQ(ask(with_prior(scan("/v1/localize"), 91.0, "0.3,0.05"))["status"], "ok");
}

TEST_F(MapSets, BadFirstScanBindsAVehicleToNoneOfSeveralMaps) {
  using localization::Reason;
  for (const bool is_found : {false, true}) {
    show("west", is_found ? std::optional(90.0) : std::nullopt, 0.4, {Reason::kAmbiguous});
    show("east", std::nullopt, 0.0);
    EXPECT_NE(ask(with_prior(scan("/v1/localize/next"), 90.0, "6,0.1"))["status"], "ok");
    show("west", 85.0);
    show("east", 95.0);
    for (int i = 1; i < 4; ++i) {
      const json answer = follow(0.1 * i);
      EXPECT_THAT(answer["reasons"], Contains("ambiguous")) << answer;
      EXPECT_NE(answer["status"], "ok");
    }
    show("west", std::nullopt, 0.0);
    EXPECT_THAT(follow(0.4)["reasons"], ElementsAre("unconfirmed"));
    const json found = follow(0.5);
    EXPECT_EQ(found["status"], "ok");
    EXPECT_EQ(found["map"]["name"], "east");
    HttpRequest older = scan("/v1/localize/next", 2);
    older.headers["stillmap-seal"] = seal_;
    EXPECT_EQ(ask(older, 409)["code"], "ScanNotNewer");
  }
}

TEST_F(MapSets, ScanThatConfirmsIsLookedForInAllMaps) {
  show("west", 50.0);
  show("east", std::nullopt, 0.0);
  EXPECT_THAT(ask(scan("/v1/localize/next"))["reasons"], ElementsAre("unconfirmed"));
  show("east", 150.0);
  EXPECT_THAT(follow(0.1)["reasons"], Contains("ambiguous"));
  show("east", std::nullopt, 0.0);
  EXPECT_THAT(follow(0.2)["reasons"], ElementsAre("unconfirmed"));
  EXPECT_EQ(follow(0.3)["status"], "ok");
  // Followed there, it is not asked of other maps, until the vehicle may be anywhere.
  show("east", 150.0);
  EXPECT_EQ(follow(0.4)["status"], "ok");
  EXPECT_THAT(follow(40.0)["reasons"], Contains("ambiguous"));
}

TEST_F(MapSets, LostVehicleStaysWhereItWas) {
  show("west", 50.0);
  show("east", std::nullopt, 0.0);
  ask(with_prior(scan("/v1/localize/next"), 50.0));
  show("west", std::nullopt, 0.1);
  show("east", std::nullopt, 0.3);
  for (int i = 1; i < 8; ++i) EXPECT_EQ(follow(2.0 * i)["map"]["name"], "west");
}

TEST_F(MapSets, BrokenNeighbourStopsNoVehicle) {
  show_vehicle();
  x_ = 60.0;
  ask(with_prior(scan("/v1/localize/next"), x_));
  aligners_["east"]->answer = [](const auto&) -> localization::AlignmentResult {
    throw maps::InputError("tile", "damaged bytes", "the map again");
  };
  for (int i = 1; i < 60; ++i) {
    x_ += 1.0;
    const json answer = follow(0.5 * i);
    EXPECT_EQ(answer["map"]["name"], "west");
    EXPECT_EQ(answer["status"], "ok");
  }
  EXPECT_THAT(service_->metrics().text(),
              ::testing::HasSubstr("stillmap_hand_overs_refused_total{map=\"east\"}"));
}

TEST_F(MapSets, MapWithoutAPlaceOnTheEarthIsOneOfTheSet) {
  add("depot", 0.0, 50.0, "v1", std::nullopt);
  while (service_->handle(scan("/v1/maps/depot/localize")).status != 200) std::this_thread::yield();
  const json members = {{{"map", "west"}}, {{"map", "depot"}, {"position", {0.0, 500.0, 0.0}}}};
  ASSERT_EQ(put("street", set_of(members)).status, 200);
  show("west", std::nullopt, 0.0);
  show("depot", 20.0);
  for (const char* path : {"/v1/localize", "/v1/localize/next"}) {
    HttpRequest in_depot = scan(path);
    in_depot.query.emplace_back("prior_t", "20,500,0");
    in_depot.query.emplace_back("prior_q", "0,0,0,1");
    in_depot.query.emplace_back("prior_sigma", "0.5,0.05");
    const json answer = ask(in_depot);
    EXPECT_EQ(answer["status"], "ok") << path;
    EXPECT_EQ(answer["map"]["name"], "depot") << path;
    in_depot.headers["accept"] = "application/geopose+json";
    EXPECT_EQ(ask(in_depot, 406)["code"], "NotAcceptable") << path;
  }
  show("west", 70.0);
  EXPECT_THAT(ask(scan("/v1/localize"))["reasons"], ElementsAre("ambiguous"));
}

TEST_F(MapSets, MapOfASetKeepsItsFrame) {
  add("west", 0.0, 100.0, "v2", 1.0);
  const auto activate = [&] {
    HttpRequest request = ServiceTest::request("POST", "/v1/maps/west/versions/v2/activate");
    request.query = {{"new_frame", "true"}};
    return service_->handle(request);
  };
  const json refused = body(activate());
  EXPECT_EQ(refused["code"], "OtherFrame");
  EXPECT_THAT(refused["detail"].get<std::string>(), ::testing::HasSubstr("'street'"));
  ASSERT_EQ(put("street", set_of({json{{"map", "east"}}})).status, 200);
  EXPECT_EQ(activate().status, 200);
}

TEST_F(MapSets, SessionTellsTheVersionInWhichItBeginsAnew) {
  show_vehicle();
  x_ = 20.0;
  json covariance = json::array();
  for (int i = 0; i < 36; ++i) covariance.push_back(i % 7 == 0 ? 0.01 : 0.0);
  const json prior = {{"position", {20.0, 0.0, 0.0}},
                      {"quaternion", {0.0, 0.0, 0.0, 1.0}},
                      {"covariance", covariance}};
  const HttpResponse opened = send("POST", "/v1/sessions", {{"set", "street"}, {"prior", prior}});
  const std::string path = "/v1/sessions/" + body(opened)["id"].get<std::string>();
  for (int i = 1; i < 3; ++i) (void)ask(scan(path + "/scans", 100'000'000 * std::int64_t{i}));
  add("west", 0.0, 100.0, "v2");
  EXPECT_EQ(send("POST", "/v1/maps/west/versions/v2/activate").status, 200);
  EXPECT_EQ(ask(scan(path + "/scans", 300'000'000))["map"]["version"], "v1");
  EXPECT_EQ(send("POST", path + "/initialize", {{"prior", prior}}).status, 200);
  EXPECT_EQ(ask(scan(path + "/scans", 1))["map"]["version"], "v2");
  EXPECT_EQ(body(get(path))["map"]["version"], "v2");
}

TEST_F(MapSets, SealIsOfItsSetWhenThereAreMore) {
  show_vehicle();
  x_ = 20.0;
  ask(with_prior(scan("/v1/localize/next"), x_));
  ASSERT_EQ(put("another", set_of({json{{"map", "east"}}})).status, 201);
  EXPECT_EQ(follow(0.1)["set"], "street");
  EXPECT_EQ(ask(scan("/v1/localize/next"), 400)["code"], "InvalidRequest");
}

TEST_F(MapSets, VehicleIsHandedOverBehindTheBorderAndBack) {
  show_vehicle();
  x_ = 70.0;
  ask(with_prior(scan("/v1/localize/next"), x_));
  double seconds = 0.0;
  std::vector<std::pair<std::string, double>> changes;
  const auto drive_to = [&](double x) {
    const double step = x > x_ ? 0.25 : -0.25;
    // It stops before it turns.
    for (int i = 0; i < 20; ++i) follow(seconds += 0.5);
    while (std::abs(x - x_) > 0.1) {
      x_ += step;
      const json answer = follow(seconds += 0.5);
      EXPECT_EQ(answer["status"], "ok") << x_ << answer;
      EXPECT_NEAR(x_in_set(answer), x_, 1e-6);
      if (warnings(answer).empty()) continue;
      EXPECT_THAT(warnings(answer), ElementsAre("handed_over"));
      changes.emplace_back(answer["map"]["name"], x_);
    }
  };
  drive_to(130.0);
  drive_to(60.0);
  ASSERT_EQ(changes.size(), 2U);
  EXPECT_EQ(changes[0].first, "east");
  EXPECT_GT(changes[0].second, 110.0);
  EXPECT_LT(changes[0].second, 114.0);
  EXPECT_EQ(changes[1].first, "west");
  EXPECT_LT(changes[1].second, 70.0);
  EXPECT_GT(changes[1].second, 66.0);
}

TEST_F(MapSets, VehicleStaysInItsMapWhileTheNextOneDoesNotShowIt) {
  show_vehicle();
  x_ = 108.0;
  ask(with_prior(scan("/v1/localize/next"), x_));
  EXPECT_EQ(follow(0.1)["map"]["name"], "east");
  aligners_["west"]->answer = [](const auto&) { return localization::AlignmentResult{}; };
  for (int i = 0; i < 240; ++i) {
    x_ -= 0.2;
    const json answer = follow(1.0 + 0.2 * i);
    EXPECT_EQ(answer["map"]["name"], "east");
    EXPECT_EQ(answer["status"], "ok") << x_ << answer;
  }
  show_vehicle();
  EXPECT_THAT(warnings(follow(50.0)), ElementsAre("handed_over"));
}

TEST_F(MapSets, SealIsForItsSetAlone) {
  show_vehicle();
  x_ = 20.0;
  ask(with_prior(scan("/v1/localize/next"), x_));
  HttpRequest next = scan("/v1/maps/west/localize/next", 2);
  next.headers["stillmap-seal"] = seal_;
  EXPECT_EQ(ask(next, 400)["code"], "InvalidSeal");
  const std::string of_set = seal_;
  ask(with_prior(scan("/v1/maps/west/localize/next"), x_));
  next = scan("/v1/localize/next", 2);
  next.headers["stillmap-seal"] = seal_;
  EXPECT_EQ(ask(next, 400)["code"], "InvalidSeal");
  next.headers["stillmap-seal"] = of_set;
  ASSERT_EQ(put("street", set_of({json{{"map", "east"}}})).status, 200);
  EXPECT_EQ(ask(next, 409)["code"], "SealedVersionGone");
}

TEST_F(MapSets, SessionOfTheServerIsHandedOverToo) {
  show_vehicle();
  json covariance = json::array();
  for (int i = 0; i < 36; ++i) covariance.push_back(i % 7 == 0 ? 0.01 : 0.0);
  const json prior = {{"position", {104.0, 0.0, 0.0}},
                      {"quaternion", {0.0, 0.0, 0.0, 1.0}},
                      {"covariance", covariance}};
  const HttpResponse opened = send("POST", "/v1/sessions", {{"set", "street"}, {"prior", prior}});
  ASSERT_EQ(opened.status, 201) << opened.body;
  EXPECT_EQ(body(opened)["set"], "street");
  const std::string path = "/v1/sessions/" + body(opened)["id"].get<std::string>();
  x_ = 104.0;
  std::vector<std::string> names;
  for (int i = 0; i < 100; ++i, x_ -= 1.0) {
    const json answer = ask(scan(path + "/scans", 1'000'000'000 + std::int64_t{i} * 500'000'000));
    EXPECT_EQ(answer["status"], "ok") << x_;
    if (names.empty() || names.back() != answer["map"]["name"])
      names.push_back(answer["map"]["name"]);
  }
  EXPECT_THAT(names, ElementsAre("east", "west"));
  const json shown = body(get(path));
  EXPECT_EQ(shown["map"]["name"], "west");
  EXPECT_EQ(shown["active_version"], "v1");
  EXPECT_EQ(send("POST", path + "/initialize", {{"prior", prior}}).status, 200);
  x_ = 104.0;
  EXPECT_EQ(ask(scan(path + "/scans", 1))["map"]["name"], "east");
  for (const json& wrong : {json{{"set", "street"}, {"map", "west"}}, json{{"version", "v1"}}})
    EXPECT_EQ(body(send("POST", "/v1/sessions", wrong))["code"], "InvalidRequest");
}

TEST_F(MapSets, KeyIsAnsweredFromItsMapsAlone) {
  show_vehicle();
  const auto with_key = [&](HttpRequest request, const std::string& key) {
    request.headers["authorization"] = "Bearer " + key;
    return request;
  };
  KeyScopes scopes;
  scopes.add(KeyScope::kLocalize);
  scopes.add(KeyScope::kWrite);
  KeyTable& keys = store_.open().keys();
  const std::string west = keys.create("west", scopes, {}, 1, {"we*"}).text;
  const std::string none = keys.create("none", scopes, {}, 1, {"town"}).text;
  x_ = 150.0;
  // The only one of its maps, however far.
  EXPECT_EQ(ask(with_key(with_prior(scan("/v1/localize"), x_), west))["map"]["name"], "west");
  const json unseen = ask(with_key(with_prior(scan("/v1/localize"), x_), none), 400);
  EXPECT_THAT(unseen["detail"].get<std::string>(), ::testing::Not(::testing::HasSubstr("street")));
  HttpRequest named = with_key(with_prior(scan("/v1/localize"), x_), none);
  named.query.emplace_back("set", "street");
  EXPECT_EQ(ask(named, 404)["code"], "UnknownSet");
  HttpRequest fix = with_key(scan("/v1/localize"), none);
  fix.query.emplace_back("gnss", "0,0.00134747,,2");
  EXPECT_EQ(ask(fix, 403)["code"], "Forbidden");
  EXPECT_EQ(ask(with_key(request("GET", "/v1/sets/street"), west))["maps"].size(), 1U);
  EXPECT_EQ(ask(with_key(request("GET", "/v1/sets/street"), none), 404)["code"], "UnknownSet");
  HttpRequest change = with_key(request("DELETE", "/v1/sets/street"), west);
  EXPECT_EQ(ask(change, 403)["code"], "Forbidden");
  x_ = 90.0;
  ask(with_key(with_prior(scan("/v1/localize/next"), x_), west));
  for (int i = 0; i < 40; ++i) {
    x_ += 1.0;
    HttpRequest next =
        with_key(scan("/v1/localize/next", 1'000'000'000 * std::int64_t{i} + 2), west);
    next.headers["stillmap-seal"] = seal_;
    EXPECT_EQ(ask(next)["map"]["name"], "west");
  }
}

}  // namespace map_sets_test
}  // namespace stillmap::server

#include <gmock/gmock.h>

#include <cmath>
#include <thread>

#include "http/base64.hpp"
#include "sealing/session_seals.hpp"
#include "service_fixture.hpp"

namespace stillmap::server {
namespace sealed_sessions_test {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr const char* kNext = "/v1/maps/town/localize/next";

/// An answer and the seal that came with it.
struct Answer {
  int status = 0;
  json body;
  std::string seal;
};

class SealedSessions : public ServiceTest {
 protected:
  void SetUp() override {
    options_.queue = 8;
    // Somewhere near the prior, by the prior and the scan alone.
    aligner_->answer = [](const auto& prior) {
      localization::AlignmentResult result;
      result.status = localization::PoseStatus::kOk;
      result.T_map_lidar = prior.T_map_lidar;
      result.T_map_lidar.translation().x() +=
          0.01 + 0.01 * std::sin(1e3 * prior.T_map_lidar.translation().x());
      result.covariance = 1e-3 * Eigen::Matrix<double, 6, 6>::Identity();
      result.inlier_ratio = 0.9;
      return result;
    };
    start();
    other_ = serve(store_.open());
  }

  /// Another server of a store.
  std::unique_ptr<Service> serve(PackageStore& store) {
    auto service = std::make_unique<Service>(
        options_, store,
        [this](const maps::MapPackage&, const localization::LocalizationOptions&) {
          return Aligners{{"default", aligner_}};
        },
        std::vector<WebAsset>{});
    while (service->handle(request("GET", "/readyz")).status != 200) std::this_thread::yield();
    return service;
  }

  static HttpRequest scan(std::int64_t stamp_ns, const std::string& seal,
                          const std::string& path = kNext) {
    HttpRequest result = request("POST", path);
    result.headers["content-type"] = "application/octet-stream";
    if (!seal.empty()) result.headers["stillmap-seal"] = seal;
    result.query = {{"stamp_ns", std::to_string(stamp_ns)}};
    result.body = raw_scan(60);
    return result;
  }
  static HttpRequest with_prior(HttpRequest scan) {
    scan.query.insert(scan.query.end(),
                      {{"prior_t", "1,2,3"}, {"prior_q", "0,0,0,1"}, {"prior_sigma", "0.1,0.1"}});
    return scan;
  }
  static HttpRequest with_odometry(HttpRequest scan, std::int64_t since_ns) {
    scan.query.insert(scan.query.end(), {{"odom_since_ns", std::to_string(since_ns)},
                                         {"odom_t", "1,0,0"},
                                         {"odom_q", "0,0,0,1"},
                                         {"odom_sigma", "0.1,0.01"}});
    return scan;
  }
  Answer ask(HttpRequest request, const Service& service) const {
    const HttpResponse response = service.handle(std::move(request));
    Answer answer{response.status, body(response), {}};
    for (const auto& [name, value] : response.headers)
      if (name == "Stillmap-Seal") answer.seal = value;
    EXPECT_EQ(answer.seal.empty(), answer.status != 200) << response.body;
    return answer;
  }
  Answer ask(HttpRequest request) const { return ask(std::move(request), *service_); }
  std::string refusal(HttpRequest request) const {
    return ask(std::move(request)).body["code"].get<std::string>();
  }
  /// Of a session that has begun.
  Answer begin() const { return ask(with_prior(scan(1'000'000'000, ""))); }

  static std::vector<std::string> warnings(const Answer& answer) {
    std::vector<std::string> codes;
    for (const json& each : answer.body["warnings"]) codes.push_back(each["code"]);
    return codes;
  }
  /// What does not differ from one answer to the next.
  static json lasting(json answer) {
    for (const char* key : {"request_id", "timing_ms", "session", "prior_to_pose"})
      answer.erase(key);
    return answer;
  }

  std::unique_ptr<Service> other_;
};

TEST_F(SealedSessions, ChainOverServersAnswersAsOneSessionOfAServer) {
  HttpRequest opening = request("POST", "/v1/sessions");
  opening.headers["content-type"] = "application/json";
  json covariance = json::array();
  for (int i = 0; i < 36; ++i) covariance.push_back(i % 7 == 0 ? 0.1 * 0.1 : 0.0);
  opening.body = json{{"map", "town"},
                      {"prior",
                       {{"position", {1.0, 2.0, 3.0}},
                        {"quaternion", {0.0, 0.0, 0.0, 1.0}},
                        {"covariance", covariance}}}}
                     .dump();
  const std::string kept =
      "/v1/sessions/" + body(service_->handle(opening))["id"].get<std::string>() + "/scans";
  std::string seal, id;
  for (int i = 1; i <= 60; ++i) {
    const std::int64_t stamp_ns = 100'000'000 * std::int64_t{i};
    // Lost now and then, with and without odometry, and once for so long that it is searched for.
    const auto calm = aligner_->answer;
    if (i % 7 == 0 || (i > 20 && i < 30))
      aligner_->answer = [](const auto&) { return localization::AlignmentResult{}; };
    HttpRequest next = scan(stamp_ns, seal);
    HttpRequest same = scan(stamp_ns, "", kept);
    if (i == 1) next = with_prior(next);
    if (i > 1 && i % 3 == 0) {
      next = with_odometry(next, stamp_ns - 100'000'000);
      same = with_odometry(same, stamp_ns - 100'000'000);
    }
    const Answer found = ask(next, i % 2 == 0 ? *service_ : *other_);
    ASSERT_EQ(found.status, 200);
    EXPECT_EQ(lasting(found.body), lasting(body(service_->handle(same)))) << "scan " << i;
    if (i == 1) id = found.body["session"];
    EXPECT_EQ(found.body["session"], id);
    EXPECT_NE(found.seal, seal);
    seal = found.seal;
    aligner_->answer = calm;
  }
}

TEST_F(SealedSessions, BeginAnywhereOrAtAPrior) {
  const Answer anywhere = ask(scan(1, ""));
  EXPECT_EQ(anywhere.body["searched_from"], "everywhere");
  EXPECT_EQ(anywhere.body["session"].get<std::string>().size(), 32U);
  EXPECT_EQ(begin().body["searched_from"], "given");
  EXPECT_NE(begin().body["session"], anywhere.body["session"]);
  HttpRequest vague = scan(1, "");
  vague.query.insert(vague.query.end(), {{"prior_t", "1,2,3"}, {"prior_q", "0,0,0,1"}});
  EXPECT_EQ(refusal(vague), "InvalidPrior");
  HttpRequest fix = scan(1, "");
  fix.query.emplace_back("gnss", "48,11,,5");
  EXPECT_EQ(refusal(fix), "NoGeodeticOrigin");
}

TEST_F(SealedSessions, BeginAtASatelliteFix) {
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
  while (get("/v1/maps/placed/ready").status != 200) std::this_thread::yield();
  HttpRequest fix = scan(1, "", "/v1/maps/placed/localize/next");
  fix.query.emplace_back("gnss", "48,11,,5");
  const Answer begun = ask(fix);
  EXPECT_EQ(begun.body["searched_from"], "given");
  HttpRequest lost = scan(2, begun.seal, "/v1/maps/placed/localize/next");
  lost.headers["accept"] = "application/geopose+json";
  aligner_->answer = [](const auto&) { return localization::AlignmentResult{}; };
  json last;
  for (int i = 0; i < 100; ++i) {
    lost.query = {{"stamp_ns", std::to_string(1'000'000'000 * std::int64_t{i} + 2)}};
    const HttpResponse response = service_->handle(lost);
    std::string seal;
    for (const auto& [name, value] : response.headers)
      if (name == "Stillmap-Seal") seal = value;
    ASSERT_FALSE(seal.empty()) << response.body;
    lost.headers["stillmap-seal"] = seal;
    last = body(response);
  }
  EXPECT_EQ(last["code"], "NoPose");
}

TEST_F(SealedSessions, TakeTheirParametersInTheRequestPartToo) {
  HttpRequest next = scan(1, "");
  next.query = {{"vehicle", "truck 7"}};
  next.headers["content-type"] = "multipart/form-data; boundary=b";
  const auto with = [&](const json& parameters) {
    next.body = "--b\r\nContent-Disposition: form-data; name=\"request\"\r\n\r\n" +
                parameters.dump() +
                "\r\n--b\r\nContent-Disposition: form-data; name=\"scan\"\r\n\r\n" + raw_scan(60) +
                "\r\n--b--\r\n";
    return next;
  };
  json prior = {{"position", {1.0, 2.0, 3.0}}, {"quaternion", {0.0, 0.0, 0.0, 1.0}}};
  EXPECT_EQ(refusal(with({{"stamp_ns", 1}, {"prior", prior}})), "InvalidPrior");
  prior["covariance"] = json::array();
  for (int i = 0; i < 36; ++i) prior["covariance"].push_back(i % 7 == 0 ? 0.01 : 0.0);
  const Answer begun = ask(with({{"stamp_ns", 1}, {"prior", prior}}));
  EXPECT_EQ(begun.body["searched_from"], "given");
  EXPECT_EQ(refusal(with({{"stamp_ns", 1}, {"method", "icp"}})), "UnknownParameter");
  EXPECT_EQ(refusal(with({{"prior", prior}})), "InvalidRequest") << "without a time";
}

TEST_F(SealedSessions, APlaceBesideASealIsRefused) {
  const std::string seal = begin().seal;
  const Answer both = ask(with_prior(scan(2'000'000'000, seal)));
  EXPECT_EQ(both.body["code"], "InvalidRequest");
  EXPECT_THAT(both.body["detail"].get<std::string>(), HasSubstr("leave out the seal"));
}

TEST_F(SealedSessions, GoOnOnlyWithNewerScans) {
  const std::string seal = begin().seal;
  for (const std::int64_t stamp_ns : {1'000'000'000, 999'999'999, -5}) {
    const Answer old = ask(scan(stamp_ns, seal));
    EXPECT_EQ(old.status, 409);
    EXPECT_EQ(old.body["code"], "ScanNotNewer");
  }
  EXPECT_EQ(ask(scan(1'000'000'001, seal)).status, 200);
}

TEST_F(SealedSessions, OfWhatCannotBeOpenedNothingIsTold) {
  const std::string seal = begin().seal;
  store_.open().add("village", "v1", store_.package());
  store_.open().activate("village", "v1");
  while (get("/v1/maps/village/ready").status != 200) std::this_thread::yield();
  const TownStore foreign;
  const std::unique_ptr<Service> stranger = serve(foreign.open());
  std::string bytes = from_base64(seal).value();
  bytes.back() = static_cast<char>(bytes.back() ^ 1);
  const json changed = lasting(ask(scan(2'000'000'000, to_base64(bytes))).body);
  EXPECT_EQ(changed["code"], "InvalidSeal");
  EXPECT_EQ(changed["status"], 400);
  EXPECT_EQ(lasting(ask(scan(2'000'000'000, seal.substr(4))).body), changed);
  EXPECT_EQ(lasting(ask(scan(2'000'000'000, "*")).body), changed);
  EXPECT_EQ(lasting(ask(scan(2'000'000'000, seal), *stranger).body), changed);
  EXPECT_EQ(lasting(ask(scan(2'000'000'000, seal, "/v1/maps/village/localize/next")).body),
            changed);
  EXPECT_EQ(ask(scan(2'000'000'000, seal)).status, 200);
}

TEST_F(SealedSessions, OfAnotherKeyAreRefused) {
  KeyScopes localize;
  localize.add(KeyScope::kLocalize);
  const auto alice = store_.open().keys().create("alice", localize, std::nullopt, 1);
  const auto bob = store_.open().keys().create("bob", localize, std::nullopt, 1);
  const auto with = [](HttpRequest request, const KeyTable::Created& key) {
    request.headers["authorization"] = "Bearer " + key.text;
    return request;
  };
  const std::string seal = ask(with(scan(1, ""), alice)).seal;
  EXPECT_EQ(refusal(with(scan(2, seal), bob)), "InvalidSeal");
  EXPECT_EQ(ask(with(scan(2, seal), alice)).status, 200);
  EXPECT_EQ(refusal(scan(2, seal)), "MissingKey");
}

TEST_F(SealedSessions, TooOldOnesSaySo) {
  std::int64_t made_ns = unix_ns();
  SessionSeals seals(std::make_unique<StoreSealKeys>(store_.folder().path()),
                     [&] { return made_ns; });
  const SealOwner owner{.key_id = "", .map = "town"};
  SealedSession session = seals.open(begin().seal, owner);
  bool is_replay = false;
  made_ns -= 61'000'000'000;
  const Answer old = ask(scan(2'000'000'000, seals.next(session, owner, is_replay)));
  EXPECT_EQ(old.status, 409);
  EXPECT_EQ(old.body["code"], "SealExpired");
  made_ns += 31'000'000'000;
  EXPECT_EQ(ask(scan(2'000'000'000, seals.next(session, owner, is_replay))).status, 200);
  session.tracker = "of another program";
  EXPECT_EQ(refusal(scan(2'000'000'000, seals.next(session, owner, is_replay))), "InvalidSeal");
}

TEST_F(SealedSessions, AReplayIsAnsweredAlikeAndSaid) {
  const std::string seal = begin().seal;
  const Answer first = ask(scan(2'000'000'000, seal));
  EXPECT_TRUE(first.body["warnings"].empty());
  Answer again = ask(scan(2'000'000'000, seal));
  EXPECT_EQ(warnings(again), std::vector<std::string>{"seal_replayed"});
  again.body["warnings"] = json::array();
  EXPECT_EQ(lasting(again.body), lasting(first.body));
  // The other server cannot know.
  EXPECT_TRUE(ask(scan(2'000'000'000, seal), *other_).body["warnings"].empty());
  // Both lines go on.
  EXPECT_EQ(ask(scan(3'000'000'000, first.seal)).status, 200);
  EXPECT_EQ(ask(scan(3'000'000'000, again.seal), *other_).status, 200);
}

TEST_F(SealedSessions, TwoServersMayAnswerTheSameSealAtOnce) {
  std::string seal = begin().seal;
  for (int i = 2; i < 30; ++i) {
    const std::int64_t stamp_ns = 1'000'000'000 * std::int64_t{i};
    Answer here, there;
    std::thread racer([&] { there = ask(scan(stamp_ns, seal), *other_); });
    here = ask(scan(stamp_ns, seal));
    racer.join();
    ASSERT_EQ(lasting(here.body), lasting(there.body));
    ASSERT_NE(here.seal, there.seal);
    seal = i % 2 == 0 ? here.seal : there.seal;
  }
}

TEST_F(SealedSessions, GoOnWithTheirVersionAfterAnActivation) {
  const Answer begun = begin();
  EXPECT_TRUE(begun.body["warnings"].empty());
  store_.open().add("town", "v2", store_.package());
  store_.open().activate("town", "v2");
  while (json::parse(get("/v1/maps/town").body)["state"] != "ready" ||
         ask(scan(1, "")).body["map"]["version"] != "v2")
    std::this_thread::yield();
  const Answer next = ask(scan(2'000'000'000, begun.seal));
  EXPECT_EQ(next.body["map"]["version"], "v1");
  ASSERT_EQ(warnings(next), std::vector<std::string>{"version_activated"});
  EXPECT_EQ(next.body["warnings"][0]["version"], "v2");
  const Answer named = ask(scan(1, "", "/v1/maps/town/versions/v1/localize/next"));
  EXPECT_EQ(named.body["map"]["version"], "v1");
  EXPECT_EQ(ask(scan(2, named.seal)).body["map"]["version"], "v1");
  EXPECT_EQ(refusal(scan(2, named.seal, "/v1/maps/town/versions/v2/localize/next")),
            "InvalidRequest");
  // Until it is removed.
  (void)store_.open().remove("town", "v1");
  const Answer gone = ask(scan(3'000'000'000, next.seal));
  EXPECT_EQ(gone.status, 409);
  EXPECT_EQ(gone.body["code"], "SealedVersionGone");
  EXPECT_THAT(gone.body["detail"].get<std::string>(), HasSubstr("begin anew without a seal"));
}

TEST_F(SealedSessions, EndWithTheRolloutThatGaveThemTheirVersion) {
  store_.open().add("town", "v2", store_.package());
  HttpRequest put = request("PUT", "/v1/maps/town/rollout");
  put.headers["content-type"] = "application/json";
  put.body = json{{"version", "v2"}, {"vehicles", {"truck 7"}}}.dump();
  ASSERT_EQ(service_->handle(put).status / 100, 2) << service_->handle(put).body;
  const auto of_truck = [](HttpRequest scan) {
    scan.query.emplace_back("vehicle", "truck 7");
    return scan;
  };
  while (ask(of_truck(scan(1, ""))).body["map"]["version"] != "v2") std::this_thread::yield();
  const Answer begun = ask(of_truck(scan(1, "")));
  const Answer next = ask(of_truck(scan(2, begun.seal)));
  EXPECT_EQ(next.body["map"]["version"], "v2");
  EXPECT_TRUE(next.body["warnings"].empty()) << "the seal knows the vehicle";
  EXPECT_TRUE(ask(scan(3, next.seal)).body["warnings"].empty());
  HttpRequest stranger = scan(3, next.seal);
  stranger.query.emplace_back("vehicle", "truck 8");
  EXPECT_EQ(refusal(stranger), "InvalidRequest");
  EXPECT_EQ(service_->handle(request("DELETE", "/v1/maps/town/rollout")).status, 204);
  EXPECT_EQ(refusal(scan(3, next.seal)), "SealedVersionGone");
}

TEST_F(SealedSessions, AreCounted) {
  const Answer begun = begin();
  ask(scan(2'000'000'000, begun.seal));
  ask(scan(2'000'000'000, begun.seal));
  refusal(scan(2'000'000'000, "x"));
  const std::string text = service_->metrics().text();
  EXPECT_THAT(text, HasSubstr("stillmap_sealed_scans_total{result=\"begun\"} 1"));
  EXPECT_THAT(text, HasSubstr("stillmap_sealed_scans_total{result=\"continued\"} 1"));
  EXPECT_THAT(text, HasSubstr("stillmap_sealed_scans_total{result=\"replayed\"} 1"));
}

}  // namespace sealed_sessions_test
}  // namespace stillmap::server

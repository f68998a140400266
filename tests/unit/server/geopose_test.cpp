// Poses as OGC GeoPose, against a truth that is composed from the place on the Earth to the map.
#include <gmock/gmock.h>

#include <GeographicLib/Geocentric.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "service_fixture.hpp"

namespace stillmap::server {
namespace geopose_test {

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

/// East, north and up as columns by their formulas, place by GeographicLib: nothing of ours.
Eigen::Isometry3d ecef_of(const maps::GeodeticOrigin& place) {
  const double lat = place.latitude_deg * kRadPerDeg;
  const double lon = place.longitude_deg * kRadPerDeg;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear().col(0) << -std::sin(lon), std::cos(lon), 0.0;
  T.linear().col(1) << -std::sin(lat) * std::cos(lon), -std::sin(lat) * std::sin(lon),
      std::cos(lat);
  T.linear().col(2) << std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat);
  GeographicLib::Geocentric::WGS84().Forward(place.latitude_deg, place.longitude_deg,
                                             place.altitude_m, T.translation().x(),
                                             T.translation().y(), T.translation().z());
  return T;
}

Eigen::Matrix3d rotation_of(const json& quaternion) {
  const Eigen::Quaterniond q(quaternion.at("w"), quaternion.at("x"), quaternion.at("y"),
                             quaternion.at("z"));
  EXPECT_NEAR(q.norm(), 1.0, 1e-15);
  return q.toRotationMatrix();
}

std::string header_of(const HttpResponse& response, const std::string& name) {
  for (const auto& [each, value] : response.headers)
    if (each == name) return value;
  return "-";
}

class GeoPose : public ServiceTest {
 protected:
  /// Serves a map `placed` with this origin; the stub finds the lidar at a place on the Earth.
  void serve(const maps::GeodeticOrigin& origin, const Eigen::Isometry3d& T_ecef_lidar) {
    const test::TemporaryFolder built;
    maps::MapPackageWriter writer(built.path() / "map");
    writer.add_tile({}, std::vector<maps::MapPoint>(3));
    writer.write_trajectory(maps::Trajectory(std::vector<maps::StampedPose>{{.stamp_ns = 1}}));
    maps::MapManifest manifest;
    manifest.frame_id = "enu";
    manifest.geodetic_origin = origin;
    (void)writer.publish(manifest, "{}");
    const std::string name = "placed" + std::to_string(++maps_);
    store_.open().add(name, "v1", built.path() / "map");
    store_.open().activate(name, "v1");
    start();
    while (get("/v1/maps/" + name + "/ready").status != 200) std::this_thread::yield();
    map_ = name;
    const Eigen::Isometry3d T_map_lidar = ecef_of(origin).inverse() * T_ecef_lidar;
    aligner_->answer = [T_map_lidar, this](const auto&) {
      localization::AlignmentResult result;
      result.status = status_;
      result.reasons = reasons_;
      result.T_map_lidar = T_map_lidar;
      result.covariance.setIdentity();
      return result;
    };
  }
  HttpResponse ask(const std::string& accept, const std::string& map,
                   const std::string& stamp_ns = {}) const {
    HttpRequest request = good_request();
    request.path = "/v1/maps/" + map + "/localize";
    if (!accept.empty()) request.headers["accept"] = accept;
    if (!stamp_ns.empty()) request.query.emplace_back("stamp_ns", stamp_ns);
    return service_->handle(request);
  }
  HttpResponse ask(const std::string& accept) const { return ask(accept, map_); }

  std::string map_;
  int maps_ = 0;
  localization::PoseStatus status_ = localization::PoseStatus::kOk;
  std::vector<localization::Reason> reasons_;
};

constexpr maps::GeodeticOrigin kKarlsruhe{49.0112, 8.42288, 112.8};
const Eigen::Matrix3d kRotation = (Eigen::AngleAxisd(2.1, Eigen::Vector3d::UnitZ()) *
                                   Eigen::AngleAxisd(0.3, Eigen::Vector3d(0.6, 0.8, 0.0)))
                                      .toRotationMatrix();

TEST_F(GeoPose, IsThePlaceAndTheRotationAgainstTheTangentPlaneAtTheVehicle) {
  struct Case {
    const char* name;
    maps::GeodeticOrigin origin, vehicle;
  };
  for (const Case& each :
       {Case{"at the origin", kKarlsruhe, kKarlsruhe},
        Case{"100 km away", kKarlsruhe, {49.9, 8.6, 250.0}},
        Case{"south", {-33.86, 151.21, 30.0}, {-33.87, 151.2, -5.0}},
        Case{"to the east of 180", {-17.0, 179.99, 1.0}, {-17.01, -179.995, 2.0}},
        Case{"to the west of 180", {65.0, -179.999, 1.0}, {65.0, 179.999, 2.0}},
        Case{"across the pole", {89.999, 10.0, 0.0}, {89.9992, -150.0, 3.0}},
        Case{"at the south pole", {-90.0, 0.0, 2800.0}, {-89.99, 77.0, 2801.0}}}) {
    SCOPED_TRACE(each.name);
    Eigen::Isometry3d T_ecef_lidar = ecef_of(each.vehicle);
    T_ecef_lidar.linear() = T_ecef_lidar.linear() * kRotation;
    serve(each.origin, T_ecef_lidar);
    const HttpResponse response = ask("application/geopose+json");
    ASSERT_EQ(response.status, 200) << response.body;
    EXPECT_EQ(response.content_type, "application/geopose+json; version=1.0");
    const json pose = body(response);
    EXPECT_EQ(pose.size(), 2U) << pose;
    const double lon = pose["position"]["lon"];
    EXPECT_NEAR(pose["position"]["lat"], each.vehicle.latitude_deg, 1e-10);
    const double circle = std::cos(each.vehicle.latitude_deg * kRadPerDeg);
    EXPECT_NEAR(circle * (lon - each.vehicle.longitude_deg), 0.0, 1e-10);
    EXPECT_GE(lon, -180.0);
    EXPECT_LE(lon, 180.0);
    EXPECT_NEAR(pose["position"]["h"], each.vehicle.altitude_m, 1e-5);
    EXPECT_LT((rotation_of(pose["quaternion"]) - kRotation).norm(), 1e-9) << pose;
  }
}

TEST_F(GeoPose, AtThePoleItselfPlaceAndRotationBelongTogether) {
  Eigen::Isometry3d T_ecef_lidar = ecef_of({90.0, 33.0, 12.0});
  T_ecef_lidar.linear() = T_ecef_lidar.linear() * kRotation;
  serve({89.99, 33.0, 0.0}, T_ecef_lidar);
  const json pose = body(ask("application/geopose+json"));
  EXPECT_NEAR(pose["position"]["lat"], 90.0, 1e-9);
  const Eigen::Isometry3d T_ecef_enu =
      ecef_of({pose["position"]["lat"], pose["position"]["lon"], pose["position"]["h"]});
  EXPECT_LT((T_ecef_enu.linear() * rotation_of(pose["quaternion"]) - T_ecef_lidar.linear()).norm(),
            1e-9);
}

TEST_F(GeoPose, IsOfTheBaseWhenItsMountIsKnown) {
  // The base stands where the truth says, the lidar is mounted on it.
  Eigen::Isometry3d T_ecef_base = ecef_of({49.02, 8.43, 100.0});
  T_ecef_base.linear() = T_ecef_base.linear() * kRotation;
  Eigen::Isometry3d T_base_lidar = Eigen::Isometry3d::Identity();
  T_base_lidar.translation() = Eigen::Vector3d(1.2, -0.3, 1.9);
  T_base_lidar.linear() =
      Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  serve(kKarlsruhe, T_ecef_base * T_base_lidar);
  HttpRequest request = this->request("POST", "/v1/maps/" + map_ + "/localize");
  request.headers = {{"content-type", "application/json"}, {"accept", "application/geopose+json"}};
  json points = json::array();
  for (int i = 0; i < 60; ++i) points.push_back({0.1 * i, 2.0, 3.0});
  const double half = std::sqrt(0.5);
  request.body = json{{"points", points},
                      {"T_base_lidar",
                       {{"position", {1.2, -0.3, 1.9}}, {"quaternion", {0.0, 0.0, half, half}}}}}
                     .dump();
  const json pose = body(service_->handle(request));
  EXPECT_NEAR(pose["position"]["lat"], 49.02, 1e-10) << pose;
  EXPECT_NEAR(pose["position"]["h"], 100.0, 1e-5);
  EXPECT_LT((rotation_of(pose["quaternion"]) - kRotation).norm(), 1e-9);
}

TEST_F(GeoPose, AdvancedHasTheFrameAndTheTime) {
  Eigen::Isometry3d T_ecef_lidar = ecef_of({49.9, 8.6, 250.0});
  T_ecef_lidar.linear() = T_ecef_lidar.linear() * kRotation;
  serve(kKarlsruhe, T_ecef_lidar);
  const std::string accept = "application/geopose+json; version=1.0; profile=\"advanced\"";
  const HttpResponse response = ask(accept, map_, "1629069964274600000");
  EXPECT_EQ(response.content_type, "application/geopose+json; version=1.0; profile=advanced");
  const json pose = body(response);
  EXPECT_EQ(pose["frameSpecification"]["authority"], "/geopose/1.0");
  EXPECT_EQ(pose["frameSpecification"]["id"], "LTP-ENU");
  EXPECT_EQ(pose["frameSpecification"]["parameters"],
            "longitude=8.6000000000&latitude=49.9000000000&height=250.00000");
  EXPECT_LT((rotation_of(pose["quaternion"]) - kRotation).norm(), 1e-9);
  EXPECT_EQ(pose["validTime"], 1629069964275);
  EXPECT_EQ(body(ask(accept, map_, "-1600000"))["validTime"], -2);
  EXPECT_FALSE(body(ask(accept)).contains("validTime"));
}

TEST_F(GeoPose, TellsTheStatusInHeaders) {
  serve(kKarlsruhe, ecef_of(kKarlsruhe));
  HttpResponse response = ask("application/geopose+json");
  EXPECT_EQ(header_of(response, "Stillmap-Status"), "ok");
  EXPECT_EQ(header_of(response, "Stillmap-Reasons"), "-");
  status_ = localization::PoseStatus::kDegraded;
  reasons_ = {localization::Reason::kAmbiguous, localization::Reason::kLargeCovariance};
  response = ask("application/geopose+json");
  EXPECT_EQ(response.status, 200);
  EXPECT_EQ(header_of(response, "Stillmap-Status"), "degraded");
  EXPECT_EQ(header_of(response, "Stillmap-Reasons"), "ambiguous, large_covariance");
}

TEST_F(GeoPose, IsNeverMadeUpForALostScan) {
  serve(kKarlsruhe, ecef_of(kKarlsruhe));
  status_ = localization::PoseStatus::kLost;
  reasons_ = {localization::Reason::kLowInlierRatio};
  const HttpResponse refused = ask("application/geopose+json");
  EXPECT_EQ(refused.status, 422);
  EXPECT_EQ(refused.content_type, "application/problem+json");
  EXPECT_EQ(body(refused)["code"], "NoPose");
  EXPECT_THAT(body(refused)["detail"].get<std::string>(), HasSubstr("low_inlier_ratio"));
  EXPECT_EQ(header_of(refused, "Stillmap-Status"), "lost");
  // It was answered, as a query: nothing was wrong with the request.
  const json stats = body(get("/v1/maps/" + map_ + "/stats"));
  EXPECT_EQ(stats["queries"]["lost"], 1);
  EXPECT_EQ(stats["refused"], 0);
  const HttpResponse told = ask("application/geopose+json, application/json;q=0.5");
  EXPECT_EQ(told.status, 200);
  EXPECT_EQ(told.content_type, "application/json");
  EXPECT_EQ(body(told)["status"], "lost");
  EXPECT_EQ(header_of(told, "Stillmap-Status"), "lost");
}

TEST_F(GeoPose, IsChosenByAccept) {
  serve(kKarlsruhe, ecef_of(kKarlsruhe));
  for (const char* json_wanted :
       {"", "*/*", "application/json", "application/*", "text/html", "application/json;q=0.1",
        "application/geopose+json;q=0.5, application/json", "application/geopose+json;q=0, */*",
        "application/geopose+json;profile=basic-ypr, application/json;q=0.1"}) {
    const HttpResponse response = ask(json_wanted);
    EXPECT_EQ(response.content_type, "application/json") << json_wanted;
    EXPECT_EQ(header_of(response, "Stillmap-Status"), "-") << json_wanted;
  }
  for (const char* wanted :
       {"application/geopose+json", "Application/GeoPose+JSON", "application/geopose+json, */*",
        "application/json, application/geopose+json",
        "application/json;q=0.9,application/geopose+json",
        "application/geopose+json;version=1.0;profile=basic-quaternion",
        "application/geopose+json;profile=advanced;q=0.2, application/geopose+json",
        "application/json;q=0.1, */*, application/geopose+json;q=0.3"})
    EXPECT_EQ(ask(wanted).content_type, "application/geopose+json; version=1.0") << wanted;
  for (const char* refused :
       {"application/geopose+json;version=2.0", "application/geopose+json;profile=basic-ypr",
        "application/geopose+json;q=0", "application/geopose+json;q=x",
        "application/geopose+json;profile=advanced;version=1.1, application/json;q=0"}) {
    const HttpResponse response = ask(refused);
    EXPECT_EQ(response.status, 406) << refused;
    EXPECT_THAT(body(response)["detail"].get<std::string>(), HasSubstr("advanced"));
  }
}

TEST_F(GeoPose, NeedsAMapWithAPlaceOnTheEarth) {
  start();
  const HttpResponse response = ask("application/geopose+json", "town");
  EXPECT_EQ(response.status, 406);
  EXPECT_EQ(body(response)["code"], "NotAcceptable");
  EXPECT_THAT(body(response)["detail"].get<std::string>(), HasSubstr("--geo-origin"));
  EXPECT_EQ(aligner_->last_scan.size(), 0U) << "refused before the work";
  EXPECT_EQ(ask("application/geopose+json, application/json;q=0.1", "town").content_type,
            "application/json");
}

TEST_F(GeoPose, IsNoAnswerOfABatch) {
  serve(kKarlsruhe, ecef_of(kKarlsruhe));
  HttpRequest request = this->request("POST", "/v1/maps/" + map_ + "/localize/batch");
  request.headers = {{"content-type", "application/json"}, {"accept", "application/geopose+json"}};
  json points = json::array();
  for (int i = 0; i < 60; ++i) points.push_back({0.1 * i, 2.0, 3.0});
  request.body = json{{"queries", {{{"points", points}}}}}.dump();
  EXPECT_EQ(service_->handle(request).status, 406);
  request.headers["accept"] += ", application/json";
  EXPECT_EQ(service_->handle(request).content_type, "application/json");
}

TEST_F(GeoPose, IsAnAnswerOfASession) {
  options_.queue = 4;
  Eigen::Isometry3d T_ecef_lidar = ecef_of({49.9, 8.6, 250.0});
  T_ecef_lidar.linear() = T_ecef_lidar.linear() * kRotation;
  serve(kKarlsruhe, T_ecef_lidar);
  HttpRequest opening = request("POST", "/v1/sessions");
  opening.headers["content-type"] = "application/json";
  opening.body = json{{"map", map_}}.dump();
  const std::string session = body(service_->handle(opening))["id"];
  HttpRequest scan = request("POST", "/v1/sessions/" + session + "/scans");
  scan.headers = {{"content-type", "application/octet-stream"},
                  {"accept", "application/geopose+json; profile=advanced"}};
  scan.body = raw_scan(60);
  HttpResponse response;
  for (int i = 1; i <= 3; ++i) {
    scan.query = {{"stamp_ns", std::to_string(100'000'000 * i)}};
    response = service_->handle(scan);
  }
  ASSERT_EQ(response.status, 200) << response.body;
  EXPECT_THAT(response.content_type, StartsWith("application/geopose+json"));
  EXPECT_EQ(body(response)["validTime"], 300);
  EXPECT_THAT(body(response)["frameSpecification"]["parameters"].get<std::string>(),
              StartsWith("longitude=8.6"));
  EXPECT_LT((rotation_of(body(response)["quaternion"]) - kRotation).norm(), 1e-6);
  EXPECT_NE(header_of(response, "Stillmap-Status"), "-");
}

}  // namespace geopose_test
}  // namespace stillmap::server

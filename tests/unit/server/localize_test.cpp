#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <latch>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <thread>

#include <stillmap/localization/thin_scan.hpp>

#include "errors/api_error.hpp"
#include "pose/pose_checks.hpp"
#include "service_fixture.hpp"
#include "support/matchers.hpp"

namespace stillmap::server {
namespace localize_test {

using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Pair;

class Localize : public ServiceTest {
 protected:
  void SetUp() override { start(); }

  json ask(const HttpRequest& request, int status = 200) const {
    const HttpResponse response = service_->handle(request);
    EXPECT_EQ(response.status, status) << response.body;
    return body(response);
  }
  static HttpRequest with(HttpRequest request, const std::string& name, const std::string& value) {
    std::erase_if(request.query, [&](const auto& each) { return each.first == name; });
    request.query.emplace_back(name, value);
    return request;
  }
  static HttpRequest json_request(const json& content) {
    HttpRequest result = request("POST", "/v1/maps/town/localize");
    result.headers["content-type"] = "application/json; charset=utf-8";
    result.body = content.dump();
    return result;
  }
  static json good_json() {
    json points = json::array();
    for (int i = 0; i < 60; ++i) points.push_back({0.1 * i, 2.0, 3.0});
    return {{"points", points},
            {"prior", {{"position", {1.0, 2.0, 3.0}}, {"quaternion", {0.0, 0.0, 0.0, 1.0}}}}};
  }
  static HttpRequest multipart_request(const std::string& parameters, const std::string& scan,
                                       const std::string& scan_type) {
    HttpRequest result = request("POST", "/v1/maps/town/localize");
    result.headers["content-type"] = "multipart/form-data; boundary=\"frontier\"";
    result.body =
        "--frontier\r\nContent-Disposition: form-data; name=\"request\"\r\nContent-Type: "
        "application/json\r\n\r\n" +
        parameters +
        "\r\n--frontier\r\nContent-Disposition: form-data; name=\"scan\"; filename=\"a.bin\"\r\n"
        "Content-Type: " +
        scan_type + "\r\n\r\n" + scan + "\r\n--frontier--\r\n";
    return result;
  }
};

TEST_F(Localize, TimesOfAPcdsPointsReachTheLocalizer) {
  std::string cloud =
      "VERSION 0.7\nFIELDS x y z t\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 60\n"
      "HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 60\nDATA ascii\n";
  for (int i = 0; i < 60; ++i) cloud += "1 2 3 0." + std::to_string(100 + i) + "\n";
  HttpRequest request = good_request();
  request.headers["content-type"] = "application/vnd.pcd";
  request.body = cloud;
  (void)ask(request);
  ASSERT_EQ(aligner_->last_scan.time_offsets_s.size(), 60U);
  EXPECT_FLOAT_EQ(aligner_->last_scan.time_offsets_s.back(), 0.159F);
}

TEST_F(Localize, TimesOfARawScansPointsReachTheLocalizer) {
  HttpRequest request = with(good_request(), "layout", "xyzit");
  request.body.clear();
  for (int i = 0; i < 60; ++i) {
    const std::array<float, 5> point{1.0F, 2.0F, 3.0F, 0.5F, 0.001F * static_cast<float>(i)};
    request.body.append(reinterpret_cast<const char*>(point.data()), sizeof(point));
  }
  (void)ask(request);
  ASSERT_EQ(aligner_->last_scan.time_offsets_s.size(), 60U);
  EXPECT_FLOAT_EQ(aligner_->last_scan.time_offsets_s.back(), 0.059F);
  request.body.pop_back();
  EXPECT_EQ(ask(request, 400)["code"], "InvalidScan");
}

TEST_F(Localize, AnswersWithEveryKeyOfTheInterface) {
  HttpRequest request = with(good_request(), "stamp_ns", "9223372036854775807");
  json answer = ask(request);
  EXPECT_EQ(answer["status"], "ok");
  EXPECT_EQ(answer["pose"]["position"], json::parse("[1.0, 2.0, 3.0]"));
  EXPECT_EQ(answer["pose"]["quaternion"], json::parse("[0.0, 0.0, 0.0, 1.0]"));
  EXPECT_FALSE(answer.contains("T_map_base"));
  EXPECT_EQ(answer["covariance"].size(), 36U);
  EXPECT_EQ(answer["covariance_order"], json::parse(R"(["tx", "ty", "tz", "rx", "ry", "rz"])"));
  EXPECT_EQ(answer["inlier_ratio"], 0.9);
  EXPECT_EQ(answer["prior_to_pose"]["m"], 0.0);
  EXPECT_EQ(answer["map"]["name"], "town");
  EXPECT_EQ(answer["map"]["version"], store_.version());
  EXPECT_EQ(answer["map"]["digest"], store_.digest());
  // A JSON number could not hold it.
  EXPECT_EQ(answer["stamp_ns"], "9223372036854775807");
  EXPECT_EQ(answer["request_id"], "test-1");
  for (const char* key : {"reasons", "rmse_m", "degenerate_directions", "iterations"}) {
    EXPECT_TRUE(answer.contains(key)) << key;
  }
  for (const char* key : {"decode", "align", "total"})
    EXPECT_GE(answer["timing_ms"][key], 0.0) << key;
}

TEST_F(Localize, SendsScanAndPriorOnAsTheyCame) {
  ask(with(with(good_request(), "prior_q", "0,0,0.6,0.8"), "prior_sigma", "0.5,0.1"));
  ASSERT_EQ(aligner_->last_scan.size(), 60U);
  EXPECT_EQ(aligner_->last_scan.positions[0], Eigen::Vector3f(1.0F, 2.0F, 3.0F));
  EXPECT_EQ(aligner_->last_prior.T_map_lidar.translation(), Eigen::Vector3d(1.0, 2.0, 3.0));
  // (0, 0, 0.6, 0.8) turns x by 2 atan(0.6 / 0.8) towards y.
  EXPECT_THAT(Eigen::Vector3d(aligner_->last_prior.T_map_lidar.linear().col(0)),
              test::IsNearVector(Eigen::Vector3d(0.28, 0.96, 0.0), 1e-12));
  ASSERT_TRUE(aligner_->last_prior.covariance);
  EXPECT_DOUBLE_EQ((*aligner_->last_prior.covariance)(0, 0), 0.25);
  EXPECT_NEAR((*aligner_->last_prior.covariance)(5, 5), 0.01, 1e-15);
}

TEST_F(Localize, AllFourContentTypesSayTheSame) {
  json parameters = good_json();
  parameters.erase("points");
  parameters["layout"] = "xyz";
  const std::string xyz = raw_scan(45);  // 45 points of 16 bytes are 60 of 12
  EXPECT_EQ(ask(multipart_request(parameters.dump(), xyz, "application/octet-stream"))["status"],
            "ok");
  EXPECT_EQ(aligner_->last_scan.size(), 60U);

  EXPECT_EQ(ask(json_request(good_json()))["status"], "ok");
  EXPECT_EQ(aligner_->last_scan.size(), 60U);
  EXPECT_FLOAT_EQ(aligner_->last_scan.positions[59].x(), 5.9F);

  std::string pcd =
      "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 1\n"
      "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 60\nDATA ascii\n";
  for (int i = 0; i < 60; ++i) pcd += "1 2 3\n";
  HttpRequest request = good_request();
  request.headers["content-type"] = "application/vnd.pcd";
  request.body = pcd;
  EXPECT_EQ(ask(request)["status"], "ok");
  EXPECT_EQ(aligner_->last_scan.size(), 60U);
  parameters.erase("layout");
  EXPECT_EQ(ask(multipart_request(parameters.dump(), pcd, "application/vnd.pcd"))["status"], "ok");
}

TEST_F(Localize, BasePoseIsGivenWhenTheMountIsKnown) {
  json content = good_json();
  content["T_base_lidar"] = {{"position", {0.0, 0.0, 1.5}}, {"quaternion", {0.0, 0.0, 1.0, 0.0}}};
  json answer = ask(json_request(content));
  EXPECT_EQ(answer["T_map_base"]["position"], json::parse("[1.0, 2.0, 1.5]"));
}

TEST_F(Localize, PointsInMovableBoxesAreLeftOutOfTheMatch) {
  json content = good_json();
  // The points lie along x at 0.1 m steps; this box, its margin of 0.1 m with it, holds 20 to 40.
  content["movable"] = {
      {{"centre", {3.0, 2.0, 3.0}}, {"size", {0.5, 1.82, 0.5}}, {"yaw", 0.5 * std::numbers::pi}}};
  json answer = ask(json_request(content));
  EXPECT_EQ(answer["status"], "ok");
  EXPECT_EQ(answer["movable_points"], 21);
  ASSERT_EQ(aligner_->last_scan.size(), 39U);
  EXPECT_FLOAT_EQ(aligner_->last_scan.positions[19].x(), 1.9F);
  EXPECT_FLOAT_EQ(aligner_->last_scan.positions[20].x(), 4.1F);
  content.erase("points");
  answer = ask(multipart_request(content.dump(), raw_scan(60), "application/octet-stream"));
  EXPECT_EQ(answer["movable_points"], 0);
  EXPECT_EQ(aligner_->last_scan.size(), 60U);
  content["movable"] = json::array();
  ask(multipart_request(content.dump(), raw_scan(60), "application/octet-stream"));
  EXPECT_EQ(aligner_->last_scan.size(), 60U);
}

TEST_F(Localize, BadMovableBoxesAreNamed) {
  const json good = {{"centre", {1, 2, 3}}, {"size", {4, 2, 1.5}}, {"yaw", 0.1}};
  const auto changed = [&](const char* key, const json& value) {
    json box = good;
    box[key] = value;
    return json::array({good, box});
  };
  const auto without = [&](const char* key) {
    json box = good;
    box.erase(key);
    return json::array({good, box});
  };
  struct Case {
    json movable;
    int status;
    std::string code, path;
  };
  const std::vector<Case> cases = {
      {json(501, good), 422, "InvalidBoxes", "501 boxes, expected at most 500"},
      {changed("size", {4, -2, 1.5}), 422, "InvalidBoxes", "movable[1].size: found 4, -2, 1.5"},
      {changed("size", {4, 0, 1.5}), 422, "InvalidBoxes", "movable[1].size"},
      {changed("size", {4, 101, 1.5}), 422, "InvalidBoxes", "movable[1].size"},
      {changed("centre", {1e6, 0, 0}), 422, "InvalidBoxes", "movable[1].centre"},
      // JSON has no NaN; what libraries write in its place is no number.
      {changed("centre", {1, nullptr, 0}), 400, "InvalidRequest", "movable[1].centre"},
      {changed("yaw", nullptr), 400, "InvalidRequest", "movable[1].yaw"},
      {changed("yaw", "0.1"), 400, "InvalidRequest", "movable[1].yaw"},
      {changed("size", {4, 2}), 400, "InvalidRequest", "movable[1].size"},
      {changed("class", "car"), 400, "UnknownParameter", "movable[1].class"},
      {without("centre"), 400, "InvalidRequest", "movable[1].centre"},
      {without("size"), 400, "InvalidRequest", "movable[1].size"},
      {without("yaw"), 400, "InvalidRequest", "movable[1].yaw"},
      {good, 400, "InvalidRequest", "movable"},
      {json::array({1}), 400, "InvalidRequest", "movable[0]"},
  };
  for (const Case& each : cases) {
    json content = good_json();
    content["movable"] = each.movable;
    json answer = ask(json_request(content), each.status);
    EXPECT_EQ(answer["code"], each.code) << each.path;
    EXPECT_THAT(answer["detail"].get<std::string>(), HasSubstr(each.path));
  }
  json content = good_json();
  content["movable"] = json(500, good);
  ask(json_request(content));
  EXPECT_EQ(ask(with(good_request(), "movable", "[]"), 400)["code"], "UnknownParameter");
}

TEST(CheckedBox, RefusesWhatIsNotFinite) {
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW((void)checked_box({1.0, bad, 3.0}, {4.0, 2.0, 1.5}, 0.0, "box"), ApiError);
    EXPECT_THROW((void)checked_box({1.0, 2.0, 3.0}, {4.0, 2.0, bad}, 0.0, "box"), ApiError);
    EXPECT_THROW((void)checked_box({1.0, 2.0, 3.0}, {4.0, 2.0, 1.5}, bad, "box"), ApiError);
  }
  EXPECT_EQ(checked_box({1.0, 2.0, 3.0}, {4.0, 2.0, 1.5}, 0.5, "box").yaw_rad, 0.5);
}

TEST_F(Localize, ProtectionIsGivenInTheLidarFrameWithoutAMount) {
  aligner_->answer = [](const auto&) {
    localization::AlignmentResult result;
    result.status = localization::PoseStatus::kOk;
    result.covariance.setIdentity();
    result.protection = {0.25, 0.5, std::numeric_limits<double>::infinity(), 0.125};
    return result;
  };
  EXPECT_EQ(ask(good_request())["protection"],
            json::parse(R"({"longitudinal_m": 0.25, "lateral_m": 0.5, "vertical_m": null,
                            "yaw_rad": 0.125})"));
}

TEST_F(Localize, ProtectionIsGivenInBaseWhenTheMountIsKnown) {
  Eigen::Matrix<double, 6, 1> deviations;
  deviations << 0.01, 0.02, 0.03, 0.001, 0.002, 0.003;
  const Eigen::Matrix<double, 6, 6> covariance = deviations.cwiseAbs2().asDiagonal();
  aligner_->answer = [&](const auto&) {
    localization::AlignmentResult result;
    result.status = localization::PoseStatus::kOk;
    result.covariance = covariance;
    result.protection = localization::protection_levels(covariance);
    return result;
  };
  json content = good_json();
  // Turned to the left on a bar 4 m in front of base: lidar x is base y, and base, seen from there,
  // swings sideways as the lidar yaws.
  content["T_base_lidar"] = {
      {"position", {4.0, 0.0, 0.0}},
      {"quaternion", {0.0, 0.0, std::numbers::sqrt2 / 2.0, std::numbers::sqrt2 / 2.0}}};
  const json answer = ask(json_request(content));
  const double deviation_to_level = localization::protection_levels(covariance).yaw_rad / 0.003;
  const auto level = [&](const char* key) {
    return answer["protection"][key].get<double>() / deviation_to_level;
  };
  EXPECT_NEAR(level("longitudinal_m"), 0.02, 1e-9);
  EXPECT_NEAR(level("lateral_m"), std::hypot(0.01, 4.0 * 0.003), 1e-9);
  // Base pitches about lidar x.
  EXPECT_NEAR(level("vertical_m"), std::hypot(0.03, 4.0 * 0.001), 1e-9);
  EXPECT_NEAR(level("yaw_rad"), 0.003, 1e-9);
  // The covariance stays that of T_map_lidar.
  EXPECT_EQ(answer["covariance"][0], 0.01 * 0.01);
}

TEST_F(Localize, NoBoundInTheLidarFrameIsNoneInBase) {
  json content = good_json();
  content["T_base_lidar"] = {{"position", {0.0, 0.0, 1.5}}, {"quaternion", {0.0, 0.0, 0.0, 1.0}}};
  const json none = json::parse(R"({"longitudinal_m": null, "lateral_m": null, "vertical_m": null,
                                    "yaw_rad": null})");
  EXPECT_EQ(ask(json_request(content))["protection"], none);
  EXPECT_EQ(ask(good_request())["protection"], none);
}

TEST_F(Localize, LostIsAnAnswerWithoutAPose) {
  aligner_->answer = [](const auto&) {
    localization::AlignmentResult result;
    result.reasons = {localization::Reason::kLowInlierRatio};
    return result;
  };
  json answer = ask(good_request());
  EXPECT_EQ(answer["status"], "lost");
  EXPECT_EQ(answer["reasons"][0], "low_inlier_ratio");
  EXPECT_TRUE(answer["pose"].is_null());
  EXPECT_TRUE(answer["covariance"].is_null());
  EXPECT_TRUE(answer["prior_to_pose"].is_null());
}

TEST_F(Localize, PriorToPoseIsTheDistanceBetweenThem) {
  aligner_->answer = [](const auto&) {
    localization::AlignmentResult result;
    result.status = localization::PoseStatus::kDegraded;
    result.T_map_lidar.translation() = Eigen::Vector3d(4.0, 6.0, 3.0);
    result.T_map_lidar.linear() =
        Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    return result;
  };
  json answer = ask(good_request());
  EXPECT_EQ(answer["status"], "degraded");
  EXPECT_NEAR(answer["prior_to_pose"]["m"].get<double>(), 5.0, 1e-12);
  EXPECT_NEAR(answer["prior_to_pose"]["rad"].get<double>(), 0.2, 1e-12);
}

TEST_F(Localize, VersionInThePathMustBeTheOneServed) {
  HttpRequest request = good_request();
  request.path = "/v1/maps/town/versions/" + store_.version() + "/localize";
  ask(request);
  request.path = "/v1/maps/town/versions/0123456789ab/localize";
  EXPECT_EQ(ask(request, 404)["code"], "UnknownVersion");
  request.path = "/v1/maps/village/localize";
  EXPECT_EQ(ask(request, 404)["code"], "UnknownMap");
}

TEST_F(Localize, BadParametersAreNamed) {
  struct Case {
    std::string name, value;
    int status;
    std::string code;
  };
  const std::vector<Case> cases = {
      {"prior", "1,2,3", 400, "UnknownParameter"},
      {"prior_t", "1,2", 400, "InvalidRequest"},
      {"prior_t", "1,2,3,4", 400, "InvalidRequest"},
      {"prior_t", "1,2,x", 400, "InvalidRequest"},
      {"prior_t", "", 400, "InvalidRequest"},
      {"prior_t", "nan,2,3", 422, "InvalidPrior"},
      {"prior_t", "inf,2,3", 422, "InvalidPrior"},
      {"prior_t", "1e9,2,3", 422, "InvalidPrior"},
      {"prior_q", "0,0,0,0", 422, "InvalidPrior"},
      {"prior_q", "0,0,0,1.01", 422, "InvalidPrior"},
      {"prior_q", "nan,0,0,1", 422, "InvalidPrior"},
      {"prior_sigma", "0,1", 422, "InvalidPrior"},
      {"prior_sigma", "1", 400, "InvalidRequest"},
      {"stamp_ns", "12.5", 400, "InvalidRequest"},
      {"stamp_ns", "9223372036854775808", 400, "InvalidRequest"},
      {"deadline_ms", "0", 400, "InvalidRequest"},
      {"deadline_ms", "600001", 400, "InvalidRequest"},
      {"layout", "xyzr", 400, "InvalidRequest"},
      {"method", "magic", 400, "UnknownMethod"},
  };
  for (const Case& each : cases) {
    json answer = ask(with(good_request(), each.name, each.value), each.status);
    EXPECT_EQ(answer["code"], each.code) << each.name << "=" << each.value;
    EXPECT_THAT(answer["detail"].get<std::string>(), HasSubstr(each.name)) << each.value;
    EXPECT_FALSE(answer["errors"].empty()) << each.name;
  }
  HttpRequest twice = good_request();
  twice.query.emplace_back("prior_t", "1,2,3");
  EXPECT_EQ(ask(twice, 400)["code"], "InvalidRequest");
}

TEST_F(Localize, QuaternionIsTakenWithinItsTolerance) {
  ask(with(good_request(), "prior_q", "0,0,0,1.0009"));
  EXPECT_NEAR(aligner_->last_prior.T_map_lidar.linear().determinant(), 1.0, 1e-12);
}

TEST_F(Localize, WithoutAPriorTheWholeMapIsSearched) {
  HttpRequest request = good_request();
  EXPECT_FALSE(ask(request, 200)["prior_to_pose"].is_null());
  EXPECT_TRUE(aligner_->had_prior);
  request.query.clear();
  EXPECT_TRUE(ask(request, 200)["prior_to_pose"].is_null());
  EXPECT_FALSE(aligner_->had_prior);
  request.query = {{"prior_t", "1,2,3"}};
  EXPECT_EQ(ask(request, 400)["code"], "InvalidRequest");
  json content = good_json();
  content.erase("prior");
  (void)ask(json_request(content), 200);
  EXPECT_FALSE(aligner_->had_prior);
}

TEST_F(Localize, BadJsonIsNamedByItsPath) {
  const auto changed = [](const std::function<void(json&)>& change) {
    json content = good_json();
    change(content);
    return content;
  };
  const auto diagonal = [](double variance) {
    std::vector<double> values(36, 0.0);
    for (std::size_t i = 0; i < 36; i += 7) values[i] = variance;
    return json(values);
  };
  struct Case {
    json content;
    int status;
    std::string code, path;
  };
  const std::vector<Case> cases = {
      {changed([](json& j) { j["colour"] = 1; }), 400, "UnknownParameter", "colour"},
      {changed([](json& j) { j["layout"] = "xyz"; }), 400, "UnknownParameter", "layout"},
      {changed([](json& j) { j["prior"]["yaw"] = 1; }), 400, "UnknownParameter", "prior.yaw"},
      {changed([](json& j) { j["prior"].erase("position"); }), 400, "InvalidRequest",
       "prior.position"},
      {changed([](json& j) { j["prior"]["position"] = "1,2,3"; }), 400, "InvalidRequest",
       "prior.position"},
      {changed([](json& j) {
         j["prior"]["quaternion"] = {0, 0, 0, 2};
       }),
       422, "InvalidPrior", "prior.quaternion"},
      // Beyond the deviations that prior_sigma may have.
      {changed([&](json& j) { j["prior"]["covariance"] = diagonal(1e-20); }), 422, "InvalidPrior",
       "prior.covariance"},
      {changed([&](json& j) { j["prior"]["covariance"] = diagonal(1e13); }), 422, "InvalidPrior",
       "prior.covariance"},
      // Its decomposition meets infinity times zero before anything negative.
      {changed([&](json& j) {
         j["prior"]["covariance"] = diagonal(1e-17);
         j["prior"]["covariance"][2] = j["prior"]["covariance"][12] = 1e308;
       }),
       422, "InvalidPrior", "prior.covariance"},
      {changed([](json& j) { j["prior"]["covariance"] = json::array({1.0}); }), 400,
       "InvalidRequest", "prior.covariance"},
      {changed([](json& j) { j["prior"]["covariance"] = json(std::vector<double>(36, 1.0)); }), 422,
       "InvalidPrior", "prior.covariance"},
      {changed([](json& j) {
         j["T_base_lidar"] = {{"position", {0, 0, 0}}, {"quaternion", {1, 1, 1, 1}}};
       }),
       422, "InvalidTransform", "T_base_lidar.quaternion"},
      {changed([](json& j) { j["stamp_ns"] = 1.5; }), 400, "InvalidRequest", "stamp_ns"},
      {changed([](json& j) { j["stamp_ns"] = 9223372036854775808U; }), 400, "InvalidRequest",
       "stamp_ns"},
      {changed([](json& j) {
         j["points"][4] = {1, 2};
       }),
       400, "InvalidRequest", "points[4]"},
      {changed([](json& j) { j["points"][4][1] = nullptr; }), 400, "InvalidRequest", "points[4]"},
      {changed([](json& j) { j["points"][4][1] = 1e30; }), 422, "InvalidPoints", "point 4"},
      {changed([](json& j) { j.erase("points"); }), 400, "InvalidRequest", "points"},
      {json::array(), 400, "InvalidRequest", "JSON"},
  };
  for (const Case& each : cases) {
    json answer = ask(json_request(each.content), each.status);
    EXPECT_EQ(answer["code"], each.code) << each.path;
    EXPECT_THAT(answer["detail"].get<std::string>(), HasSubstr(each.path));
  }
}

TEST_F(Localize, ZerosInJsonAreNoReturnAsInAllFormats) {
  json content = good_json();
  content["points"].push_back({0, 0, 0});
  content["points"].push_back({0.0, -0.0, 1e-300});
  EXPECT_EQ(ask(json_request(content))["status"], "ok");
  EXPECT_EQ(aligner_->last_scan.size(), good_json()["points"].size());
}

TEST_F(Localize, PointsThatAreNotFiniteAreNoReturnAsInFiles) {
  HttpRequest request = good_request();
  request.body = raw_scan(60);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  std::memcpy(request.body.data() + 16, &nan, sizeof(nan));
  std::memcpy(request.body.data() + 40, &inf, sizeof(inf));
  const json answer = ask(request);
  EXPECT_EQ(answer["status"], "ok");
  EXPECT_EQ(answer["no_returns"], 2);
  EXPECT_EQ(aligner_->last_scan.size(), 58U);
}

/// `raw_scan`, thinned for a vehicle of this size.
std::string thin_scan(const std::string& raw, double own_vehicle_m = localization::kOwnVehicleM) {
  const localization::ScanView view{
      .xyz = raw.data(), .xyz_stride_bytes = 16, .size = raw.size() / 16};
  const auto bytes =
      localization::encode_thin_scan(view, localization::ThinProfile::kExact, own_vehicle_m);
  return {bytes.begin(), bytes.end()};
}

TEST_F(Localize, ThinnedScansAreTaken) {
  HttpRequest request = good_request();
  request.headers["content-type"] = "application/vnd.stillmap.scan";
  std::erase_if(request.query, [](const auto& each) { return each.first == "layout"; });
  std::string raw;
  for (int i = 0; i < 60; ++i) {
    const std::array<float, 4> point{10.0F + static_cast<float>(i), 2.0F, 3.0F, 0.5F};
    raw.append(reinterpret_cast<const char*>(point.data()), sizeof(point));
  }
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(raw.data(), &nan, sizeof(nan));
  request.body = thin_scan(raw);
  const json answer = ask(request);
  EXPECT_EQ(answer["status"], "ok");
  EXPECT_EQ(answer["no_returns"], 1);
  EXPECT_EQ(aligner_->last_scan.size(), 59U);
  json parameters = good_json();
  parameters.erase("points");
  EXPECT_EQ(ask(multipart_request(parameters.dump(), request.body,
                                  "application/vnd.stillmap.scan"))["status"],
            "ok");
  // Which points lie in boxes is asked of the whole scan.
  parameters["movable"] = {{{"centre", {3.0, 2.0, 3.0}}, {"size", {0.5, 1.8, 0.5}}, {"yaw", 0.0}}};
  const json refused =
      ask(multipart_request(parameters.dump(), request.body, "application/vnd.stillmap.scan"), 415);
  EXPECT_THAT(refused["detail"], HasSubstr("expected the whole scan"));
  request.body = thin_scan(raw, 4.0);
  EXPECT_THAT(ask(request, 400)["detail"], HasSubstr("thinned with own_vehicle_m 4, expected 2.7"));
  request.body.pop_back();
  EXPECT_EQ(ask(request, 400)["code"], "InvalidScan");
}

TEST_F(Localize, RowsOfZerosInAPriorsCovarianceAreNotTold) {
  json content = good_json();
  std::vector<double> values(36, 0.0);
  values[0] = values[7] = 0.25;  // x and y of a planar localizer
  values[35] = 0.0625;
  values[1] = 0.1;
  values[6] = 0.1 + 1e-8;  // a 32-bit float between
  content["prior"]["covariance"] = values;
  (void)ask(json_request(content));
  ASSERT_TRUE(aligner_->last_prior.covariance);
  const Eigen::Matrix<double, 6, 6>& covariance = *aligner_->last_prior.covariance;
  EXPECT_EQ(covariance, covariance.transpose());
  EXPECT_DOUBLE_EQ(covariance(0, 0), 0.25);
  EXPECT_NEAR(covariance(0, 1), 0.1, 1e-8);
  EXPECT_DOUBLE_EQ(covariance(2, 2), 4.0);
  EXPECT_NEAR(std::sqrt(covariance(3, 3)), 0.4 / 3.0, 1e-12);
  EXPECT_DOUBLE_EQ(covariance(5, 5), 0.0625);
  // A variance of zero beside numbers is an error, and named.
  values[14] = 0.0;
  values[2] = values[12] = 0.1;
  content["prior"]["covariance"] = values;
  EXPECT_THAT(ask(json_request(content), 422)["detail"].get<std::string>(),
              HasSubstr("the variance of tz (row 2) is 0"));
  values[12] = 0.0;
  content["prior"]["covariance"] = values;
  EXPECT_THAT(ask(json_request(content), 422)["detail"].get<std::string>(),
              HasSubstr("not symmetric: row 2, column 0 is 0, the other way 0.1"));
}

TEST_F(Localize, HostileJsonIsRefused) {
  HttpRequest request = json_request(good_json());
  for (const std::string& text :
       {std::string(), std::string("{"), std::string("\xff\xfe"), std::string(100'000, '['),
        std::string("{\"points\": [[1, 2, NaN]]}")}) {
    request.body = text;
    EXPECT_EQ(ask(request, 400)["code"], "InvalidRequest") << text.substr(0, 40);
  }
  request.body = std::string(options_.max_json_bytes + 1, ' ');
  EXPECT_EQ(ask(request, 413)["code"], "PayloadTooLarge");
}

TEST_F(Localize, BadScansAreRefused) {
  HttpRequest request = good_request();
  request.body.resize(request.body.size() - 3);
  EXPECT_EQ(ask(request, 400)["code"], "InvalidScan");
  request.body = raw_scan(options_.min_scan_points - 1);
  EXPECT_EQ(ask(request, 422)["code"], "TooFewPoints");
  request.body.clear();
  EXPECT_EQ(ask(request, 422)["code"], "TooFewPoints");
  request.body = raw_scan(60);
  const float far = 1e9F;
  std::memcpy(request.body.data() + 16, &far, sizeof(far));
  EXPECT_EQ(ask(request, 422)["code"], "InvalidPoints");
  request.headers["content-type"] = "application/vnd.pcd";
  EXPECT_EQ(ask(request, 400)["code"], "InvalidScan");
}

TEST_F(Localize, TooManyPointsAreRefusedBeforeTheyAreDecoded) {
  options_.max_scan_points = 100;
  start();
  HttpRequest request = good_request();
  request.body = raw_scan(101);
  EXPECT_EQ(ask(request, 413)["code"], "PayloadTooLarge");
  request.body = raw_scan(100);
  ask(request);
}

TEST_F(Localize, UnknownContentTypesAreRefused) {
  HttpRequest request = good_request();
  request.headers["content-type"] = "text/plain";
  EXPECT_EQ(ask(request, 415)["code"], "UnsupportedMediaType");
  request.headers.erase("content-type");
  EXPECT_EQ(ask(request, 415)["code"], "UnsupportedMediaType");
  EXPECT_EQ(ask(multipart_request("{}", "x", "image/png"), 415)["code"], "UnsupportedMediaType");
}

TEST_F(Localize, QueryBesideJsonIsRefusedInsteadOfIgnored) {
  HttpRequest request = json_request(good_json());
  request.query = {{"prior_t", "9,9,9"}};
  json answer = ask(request, 400);
  EXPECT_EQ(answer["code"], "UnknownParameter");
  EXPECT_THAT(answer["detail"].get<std::string>(), HasSubstr("prior_t"));
}

TEST_F(Localize, BrokenMultipartIsRefused) {
  const HttpRequest good = multipart_request(good_json().dump(), "x", "application/octet-stream");
  for (const std::string& text :
       {std::string("--frontier"), std::string("--frontier\r\n\r\n"), std::string("--other--"),
        good.body.substr(0, good.body.size() - 10)}) {
    HttpRequest request = good;
    request.body = text;
    EXPECT_EQ(ask(request, 400)["code"], "InvalidRequest") << text.substr(0, 40);
  }
  HttpRequest request = good;
  request.headers["content-type"] = "multipart/form-data";
  EXPECT_EQ(ask(request, 400)["code"], "InvalidRequest");
}

TEST_F(Localize, ParametersBesideAScanAreShort) {
  json content = good_json();
  content.erase("points");
  // As long as they may honestly be: all boxes with all digits, over many lines.
  constexpr double kThird = -1.0 / 3.0;
  content["movable"] = std::vector<json>(500, {{"centre", {kThird, kThird, kThird}},
                                               {"size", {-kThird, -kThird, -kThird}},
                                               {"yaw", kThird}});
  content["T_base_lidar"] = content["prior"];
  content["prior"]["covariance"] = std::vector<double>(36, 0.0);
  for (int i = 0; i < 36; i += 7) content["prior"]["covariance"][i] = -kThird;
  const std::string longest = content.dump(2);
  EXPECT_GT(longest.size(), std::size_t{100} << 10U);
  ask(multipart_request(longest, raw_scan(60), "application/octet-stream"));
  const std::string longer = content.dump() + std::string(std::size_t{256} << 10U, ' ');
  const json refused =
      ask(multipart_request(longer, raw_scan(60), "application/octet-stream"), 413);
  EXPECT_EQ(refused["code"], "PayloadTooLarge");
  EXPECT_EQ(refused["errors"][0]["path"], "request");
}

TEST_F(Localize, FullQueueAnswersBusyAtOnce) {
  std::latch running(1);
  std::latch release(1);
  aligner_->answer = [&](const auto&) {
    running.count_down();
    release.wait();
    return localization::AlignmentResult{};
  };
  std::thread first([this] { ask(good_request()); });
  running.wait();
  const HttpResponse second = service_->handle(good_request());
  EXPECT_EQ(second.status, 503);
  EXPECT_EQ(body(second)["code"], "Busy");
  EXPECT_THAT(second.headers, Contains(Pair("Retry-After", "1")));
  release.count_down();
  first.join();
}

TEST_F(Localize, WaitingEndsAtTheDeadline) {
  options_.queue = 1;
  start();
  std::latch running(1);
  std::latch release(1);
  aligner_->answer = [&](const auto&) {
    running.count_down();
    release.wait();
    return localization::AlignmentResult{};
  };
  std::thread first([this] { ask(good_request()); });
  running.wait();
  EXPECT_EQ(ask(with(good_request(), "deadline_ms", "150"), 504)["code"], "DeadlineExceeded");
  release.count_down();
  first.join();
}

TEST_F(Localize, AnswerThatComesAfterItsDeadlineIsNotSent) {
  aligner_->answer = [](const auto&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    return localization::AlignmentResult{};
  };
  EXPECT_EQ(ask(with(good_request(), "deadline_ms", "10"), 504)["code"], "DeadlineExceeded");
}

TEST_F(Localize, WorkEndsWhenItsClientHasGone) {
  HttpRequest gone = good_request();
  gone.client_gone = [] { return true; };
  aligner_->answer = [](const auto&) -> localization::AlignmentResult {
    ADD_FAILURE() << "aligned for nobody";
    return {};
  };
  EXPECT_EQ(ask(gone, 499)["code"], "ClientGone");
}

// The text itself is not read to its end: it breaks off at a point that is none.
TEST_F(Localize, JsonIsReadNoLongerThanItsClientWaits) {
  HttpRequest long_text = request("POST", "/v1/maps/town/localize");
  long_text.headers["content-type"] = "application/json";
  long_text.body = "{\"points\":[[1,2,3]";
  for (int i = 0; i < 20'000; ++i) long_text.body += ",[1,2,3]";
  long_text.body += "!";
  int looks = 0;
  long_text.client_gone = [&] { return ++looks > 5; };
  EXPECT_EQ(ask(long_text, 499)["code"], "ClientGone");
  EXPECT_EQ(looks, 6);
}

TEST_F(Localize, UnforeseenFailureIsSaidWithoutItsDetails) {
  aligner_->answer = [](const auto&) -> localization::AlignmentResult {
    throw std::runtime_error("secret");
  };
  const HttpResponse response = service_->handle(good_request());
  EXPECT_EQ(response.status, 500);
  EXPECT_EQ(body(response)["code"], "InternalError");
  EXPECT_THAT(response.body, ::testing::Not(HasSubstr("secret")));
  // The worker is free again.
  aligner_->answer = StubAligner().answer;
  ask(good_request());
}

}  // namespace localize_test
}  // namespace stillmap::server

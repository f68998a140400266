#include "detection/onnx/onnx_detector.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "onnx_network.hpp"
#include "small_drive.hpp"
#include "support/matchers.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace onnx_detector_test {

using nlohmann::json;
using test::IsNearVector;
using test::ThrowsSaying;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using namespace test_onnx;

/// What single precision leaves of the numbers below.
constexpr double kTolerance = 1e-5;

double sigmoid(double x) { return 1.0 / (1.0 + std::exp(-x)); }

/// Tests that run a network are skipped where there is no ONNX Runtime.
class OnnxDetectorRuns : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::getenv("STILLMAP_ONNXRUNTIME") == nullptr)
      GTEST_SKIP() << "no ONNX Runtime: STILLMAP_ONNXRUNTIME names none";
  }
  static OnnxDetector detector_of(const json& description) {
    return OnnxDetector(Described(description).file(), onnx_runtime_library());
  }
  static std::vector<maps::Box> detect(const json& description, const maps::PointCloud& cloud) {
    maps::Scan scan;
    scan.cloud = cloud;
    return detector_of(description).detect(scan, flat_ground());
  }
};

/// 2 m over the ground in the head cell of row 1, column 2.
maps::PointCloud car_scan() {
  maps::PointCloud cloud;
  cloud.positions = {{2.6F, -0.7F, 0.2F}};
  return cloud;
}

void expect_the_car(const std::vector<maps::Box>& boxes) {
  ASSERT_THAT(boxes, SizeIs(1));
  EXPECT_EQ(boxes[0].object_class, maps::ObjectClass::kCar);
  EXPECT_THAT(boxes[0].centre, IsNearVector(Eigen::Vector3d(2.25, -0.25, kGround + 1.0), 1e-5));
  EXPECT_THAT(boxes[0].size_m, IsNearVector(Eigen::Vector3d(4.0, 2.0, 1.5), 1e-5));
  EXPECT_NEAR(boxes[0].yaw_rad, std::atan2(0.8, 0.6), kTolerance);
  EXPECT_NEAR(boxes[0].score, sigmoid(4.0 * 2.0 - 6.0), kTolerance);
}

TEST_F(OnnxDetectorRuns, FindsTheBoxThatTheWeightsSay) {
  expect_the_car(detect(bev_description(), car_scan()));
}

TEST_F(OnnxDetectorRuns, TellsClassesByTheirChannel) {
  maps::PointCloud cloud = car_scan();
  // Nine low points in one cell, of row 3 and column 0 of the head.
  cloud.positions.insert(cloud.positions.end(), 9, {0.6F, 1.2F, -1.7F});
  const auto boxes = detect(bev_description(), cloud);
  ASSERT_THAT(boxes, SizeIs(2));
  EXPECT_EQ(boxes[0].object_class, maps::ObjectClass::kPedestrian);
  EXPECT_THAT(boxes[0].centre, IsNearVector(Eigen::Vector3d(0.25, 1.75, kGround + 0.05), 1e-5));
  EXPECT_NEAR(boxes[0].score, sigmoid(4.0 * std::log(10.0) - 5.0), kTolerance);
  EXPECT_EQ(boxes[1].object_class, maps::ObjectClass::kCar);
}

TEST_F(OnnxDetectorRuns, DropsClassesWithoutAName) {
  json description = bev_description();
  description["heads"][0]["classes"] = {"", "pedestrian"};
  EXPECT_THAT(detect(description, car_scan()), IsEmpty());
}

TEST_F(OnnxDetectorRuns, TakesScoresAsTheyAreWhereToldSo) {
  json description = bev_description();
  description["scores"] = "scores";
  description["heads"][0]["heat_map"] = "scores";
  expect_the_car(detect(description, car_scan()));
}

TEST_F(OnnxDetectorRuns, RefusesLogitsThatAreCalledScores) {
  json description = bev_description();
  description["scores"] = "scores";
  EXPECT_THAT([&] { (void)detect(description, car_scan()); },
              ThrowsSaying<maps::InputError>({"bev.onnx", "logits", "scores in [0, 1]"}));
}

TEST_F(OnnxDetectorRuns, KeepsTheBetterOfTwoBoxesOnOnePlace) {
  maps::PointCloud cloud = car_scan();
  cloud.positions.push_back({1.6F, -0.7F, 0.0F});
  json description = bev_description();
  expect_the_car(detect(description, cloud));
  description["nms_iou"] = 1.0;
  EXPECT_THAT(detect(description, cloud), SizeIs(2));
  description["nms"] = "maxpool";
  expect_the_car(detect(description, cloud));
}

TEST_F(OnnxDetectorRuns, AddsUpSeveralHeads) {
  json description = bev_description();
  description["nms_iou"] = 1.0;
  description["heads"].push_back(description["heads"][0]);
  description["heads"][1]["classes"] = {"truck", ""};
  const auto boxes = detect(description, car_scan());
  ASSERT_THAT(boxes, SizeIs(2));
  EXPECT_EQ(boxes[1].object_class, maps::ObjectClass::kTruck);
}

/// A pillar at row 1, column 2 of z 1.8, 2.0 and 1.0 over the ground.
maps::PointCloud pillar_scan() {
  maps::PointCloud cloud;
  cloud.positions = {{2.6F, -0.7F, 0.0F}, {2.3F, -0.6F, 0.2F}, {2.4F, -0.1F, -0.8F}};
  return cloud;
}

TEST_F(OnnxDetectorRuns, FeedsPillars) {
  const auto boxes = detect(pillars_description(), pillar_scan());
  ASSERT_THAT(boxes, SizeIs(1));
  // Offsets are 0.5 plus the largest distances from the centre in x and from the mean in z; the
  // length is the count of points.
  EXPECT_THAT(boxes[0].centre,
              IsNearVector(Eigen::Vector3d(2.5 + 0.1, -0.5 + 0.4, kGround + 1.0), 1e-5));
  EXPECT_THAT(boxes[0].size_m, IsNearVector(Eigen::Vector3d(3.0, 2.0, 1.5), 1e-5));
  EXPECT_NEAR(boxes[0].yaw_rad, std::atan2(0.6, 0.8), kTolerance);
  EXPECT_NEAR(boxes[0].score, sigmoid(4.0 * 2.0 - 6.0), kTolerance);
}

TEST_F(OnnxDetectorRuns, FindsNothingInAnEmptyScan) {
  EXPECT_THAT(detect(pillars_description(), {}), IsEmpty());
  EXPECT_THAT(detect(bev_description(), {}), IsEmpty());
}

TEST_F(OnnxDetectorRuns, GivesTheSameInSeveralThreads) {
  const OnnxDetector detector = detector_of(bev_description());
  maps::Scan scan;
  scan.cloud = car_scan();
  std::vector<std::vector<maps::Box>> found(4);
  std::vector<std::thread> threads;
  for (auto& boxes : found)
    threads.emplace_back([&] { boxes = detector.detect(scan, flat_ground()); });
  for (std::thread& thread : threads) thread.join();
  for (const auto& boxes : found) {
    expect_the_car(boxes);
    EXPECT_EQ(boxes[0].centre, found[0][0].centre);
  }
}

TEST_F(OnnxDetectorRuns, IsMadeByItsName) {
  const Described description(bev_description());
  const auto detector = make_detector("onnx:" + description.file().string(), 1);
  maps::Scan scan;
  scan.cloud = car_scan();
  expect_the_car(detector->detect(scan, flat_ground()));
}

TEST_F(OnnxDetectorRuns, IsNamedInTheManifestByContent) {
  const Described description(bev_description());
  const test::TemporaryFolder folder;
  MapBuildOptions options;
  options.detector = "onnx:" + description.file().string();
  options.threads = 1;
  const CancelFlag cancel{false};
  (void)build_map({test::SmallDrive().write(folder)}, folder.path() / "map", options, {}, cancel);
  const auto map = maps::MapPackage::open(folder.path() / "map");
  EXPECT_EQ(map->manifest().options.at("detector"), "onnx:network.json");
  EXPECT_EQ(map->manifest().sources.at("onnx_description_sha256"),
            maps::sha256_of_file(description.file()));
  EXPECT_EQ(map->manifest().sources.at("onnx_model_sha256"),
            maps::sha256_of_file(description.folder().path() / "bev.onnx"));
}

TEST_F(OnnxDetectorRuns, RefusesTensorsThatTheModelDoesNotHave) {
  json input = bev_description();
  input["input"]["tensor"] = "picture";
  EXPECT_THAT([&] { detector_of(input); },
              ThrowsSaying<maps::InputError>({"bev.onnx", "inputs 'bev'", "'picture'"}));
  json output = bev_description();
  output["heads"][0]["size"] = "dim";
  EXPECT_THAT([&] { detector_of(output); },
              ThrowsSaying<maps::InputError>({"bev.onnx", "'logits', 'scores'", "'dim'"}));
}

TEST_F(OnnxDetectorRuns, RefusesShapesOtherThanDescribed) {
  json channels = bev_description();
  channels["input"]["channels"] = {"max_z", "mean_z", "log_count"};
  EXPECT_THAT([&] { detector_of(channels); },
              ThrowsSaying<maps::InputError>({"'bev' as float [1, 2, 8, 8]", "[1, 3, 8, 8]"}));
  json stride = bev_description();
  stride["stride"] = 4;
  EXPECT_THAT([&] { detector_of(stride); },
              ThrowsSaying<maps::InputError>({"'logits' as float [1, 2, 4, 4]", "[1, 2, 2, 2]"}));
  json classes = bev_description();
  classes["heads"][0]["classes"] = json::array({"car"});
  EXPECT_THAT([&] { detector_of(classes); }, ThrowsSaying<maps::InputError>({"[1, 1, 4, 4]"}));
}

TEST_F(OnnxDetectorRuns, RefusesAnInputOfAnotherType) {
  json description = pillars_description();
  description["input"]["points"] = "cells";
  EXPECT_THAT([&] { detector_of(description); },
              ThrowsSaying<maps::InputError>({"'cells' as int32 [-1, 4]", "float [-1, 4, 3]"}));
}

TEST_F(OnnxDetectorRuns, RefusesOutputsThatTurnOutOtherThanDescribed) {
  json description = bev_description();
  description["heads"][0]["offset"] = "open";
  EXPECT_THAT([&] { (void)detect(description, car_scan()); },
              ThrowsSaying<maps::InputError>({"'open' as float [1, 3, 4, 4]", "[1, 2, 4, 4]"}));
}

TEST_F(OnnxDetectorRuns, PassesOnWhatTheLibrarySaysOfABrokenModel) {
  const Described description(bev_description());
  (void)description.folder().write("bev.onnx", "no model");
  EXPECT_THAT([&] { OnnxDetector(description.file(), onnx_runtime_library()); },
              ThrowsSaying<maps::InputError>({"bev.onnx", "a model that this ONNX Runtime"}));
}

TEST(OnnxDetector, SaysWhereItLookedForALibraryThatIsNotThere) {
  const Described description(bev_description());
  EXPECT_THAT([&] { OnnxDetector(description.file(), "/nowhere/libonnxruntime.so.1"); },
              ThrowsSaying<maps::InputError>({"/nowhere/libonnxruntime.so.1", "cannot open",
                                              "libonnxruntime.so.1 where the loader looks",
                                              "STILLMAP_ONNXRUNTIME"}));
}

TEST(OnnxDetector, RefusesALibraryThatIsNoOnnxRuntime) {
  const Described description(bev_description());
  EXPECT_THAT([&] { OnnxDetector(description.file(), "libm.so.6"); },
              ThrowsSaying<maps::InputError>({"libm.so.6", "no symbol OrtGetApiBase"}));
}

TEST(OnnxDetector, RefusesALibraryThatIsTooOld) {
  const Described description(bev_description());
  EXPECT_THAT([&] { OnnxDetector(description.file(), STILLMAP_OLD_ONNXRUNTIME); },
              ThrowsSaying<maps::InputError>({STILLMAP_OLD_ONNXRUNTIME, "0.3.1", "no C API 1"}));
}

TEST(OnnxDetector, NamesAModelThatIsMissing) {
  json description = bev_description();
  description["model"] = "other.onnx";
  const Described described(description);
  EXPECT_THAT([&] { OnnxDetector(described.file(), STILLMAP_OLD_ONNXRUNTIME); },
              ThrowsSaying<maps::InputError>({"other.onnx", "no file"}));
}

}  // namespace onnx_detector_test
}  // namespace stillmap::mapping

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "detection/onnx/dense_decoding.hpp"
#include "detection/onnx/dense_input.hpp"
#include "onnx_network.hpp"
#include "support/matchers.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace onnx_dense_test {

using test::IsNearVector;
using test::ThrowsSaying;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using namespace test_onnx;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

OnnxConfig config_of(const nlohmann::json& description) {
  return read_onnx_config(Described(description).file());
}

std::vector<float> floats_of(const OnnxTensor& tensor) {
  return std::get<std::vector<float>>(tensor.values);
}

std::vector<float> bev_of(const OnnxConfig& config, const maps::PointCloud& cloud) {
  return floats_of(bev_tensor(
      config, cloud, NetworkHeight(config.z, config.sensor_height_m, flat_ground().surface.get())));
}

TEST(BevTensor, HoldsHeightsOverTheGroundByChannelRowAndColumn) {
  nlohmann::json description = bev_description();
  description["input"]["channels"] = {"mean_intensity", "max_z", "mean_z", "log_count"};
  const OnnxConfig config = config_of(description);
  maps::PointCloud cloud;
  cloud.positions = {{2.6F, -0.7F, 0.2F}, {2.7F, -0.6F, -0.8F}, {0.1F, 1.9F, -1.6F}};
  cloud.intensities = {1.0F, 4.0F, 7.0F};
  const OnnxTensor tensor = bev_tensor(
      config, cloud, NetworkHeight(config.z, config.sensor_height_m, flat_ground().surface.get()));
  EXPECT_THAT(tensor.shape, ElementsAre(1, 4, 8, 8));
  const std::vector<float> values = floats_of(tensor);
  ASSERT_THAT(values, SizeIs(4 * 64));
  const std::size_t two = 2 * 8 + 5, one = 7 * 8 + 0;
  EXPECT_FLOAT_EQ(values[two], 2.5F);
  EXPECT_FLOAT_EQ(values[64 + two], 2.0F);
  EXPECT_FLOAT_EQ(values[128 + two], 1.5F);
  EXPECT_FLOAT_EQ(values[192 + two], std::log(3.0F));
  EXPECT_FLOAT_EQ(values[one], 7.0F);
  EXPECT_NEAR(values[64 + one], 0.2F, 1e-6F);
  EXPECT_EQ(std::count(values.begin(), values.end(), 0.0F), 4 * 62);
}

TEST(BevTensor, LeavesOutWhatIsOutsideTheRangeOrOverUnknownGround) {
  const OnnxConfig config = config_of(bev_description());
  maps::PointCloud cloud;
  cloud.positions = {{-0.01F, 0.0F, 0.0F}, {4.0F, 0.0F, 0.0F},  {1.0F, -2.01F, 0.0F},
                     {1.0F, 2.0F, 0.0F},   {1.0F, 0.0F, 1.21F}, {1.0F, 0.0F, -2.81F},
                     {3.6F, 0.0F, 0.0F},   {kNaN, 0.0F, 0.0F},  {1.0F, 0.0F, kNaN}};
  EXPECT_THAT(bev_of(config, cloud), Each(0.0F));
  EXPECT_THAT(floats_of(bev_tensor(config, cloud,
                                   NetworkHeight(config.z, config.sensor_height_m, nullptr))),
              Each(0.0F));
}

TEST(BevTensor, CountsZFromTheSensorsHeightWhereToldSo) {
  nlohmann::json description = bev_description();
  description["z"] = "lidar";
  description["sensor_height_m"] = 1.7;
  const OnnxConfig config = config_of(description);
  maps::PointCloud cloud;
  // Over unknown ground too: what counts is the ground under the sensor, at -1.8 instead of -1.7.
  cloud.positions = {{3.9F, 0.1F, 0.5F}};
  EXPECT_FLOAT_EQ(bev_of(config, cloud)[4 * 8 + 7], 0.6F);
  EXPECT_FLOAT_EQ(
      floats_of(bev_tensor(config, cloud,
                           NetworkHeight(config.z, config.sensor_height_m, nullptr)))[4 * 8 + 7],
      0.5F);
}

TEST(PillarTensors, HoldTheFirstPointsOfEachCellInTheOrderOfTheScan) {
  nlohmann::json description = pillars_description();
  description["input"]["most_points"] = 2;
  description["input"]["features"] = {"x",       "y",       "z",         "intensity", "mean_dx",
                                      "mean_dy", "mean_dz", "centre_dx", "centre_dy"};
  const OnnxConfig config = config_of(description);
  maps::PointCloud cloud;
  cloud.positions = {
      {2.5F, 1.25F, -0.8F}, {1.25F, -1.5F, -1.3F}, {2.75F, 1.75F, 0.2F}, {2.1F, 1.1F, 0.1F}};
  cloud.intensities = {1.0F, 2.0F, 3.0F, 4.0F};
  const Pillars pillars = pillar_tensors(
      config, cloud, NetworkHeight(config.z, config.sensor_height_m, flat_ground().surface.get()));
  EXPECT_THAT(pillars.points.shape, ElementsAre(2, 2, 9));
  EXPECT_THAT(pillars.cells.shape, ElementsAre(2, 4));
  EXPECT_THAT(std::get<std::vector<std::int64_t>>(pillars.cells.values),
              ElementsAre(0, 0, 0, 1, 0, 0, 3, 2));
  EXPECT_THAT(pillars.counts.shape, ElementsAre(2));
  EXPECT_THAT(std::get<std::vector<std::int64_t>>(pillars.counts.values), ElementsAre(1, 2));
  const std::vector<float> wanted{
      1.25F, -1.5F, 0.5F, 2.0F, 0.0F,    0.0F,   0.0F,  -0.25F, 0.0F,    // row 0, column 1
      0.0F,  0.0F,  0.0F, 0.0F, 0.0F,    0.0F,   0.0F,  0.0F,   0.0F,    // beyond its count
      2.5F,  1.25F, 1.0F, 1.0F, -0.125F, -0.25F, -0.5F, 0.0F,   -0.25F,  // row 3, column 2
      2.75F, 1.75F, 2.0F, 3.0F, 0.125F,  0.25F,  0.5F,  0.25F,  0.25F};
  EXPECT_THAT(floats_of(pillars.points), ::testing::Pointwise(::testing::FloatNear(1e-6F), wanted));
}

/// Outputs of a head of 4 x 4 cells of 1 m that says nothing anywhere.
struct Outputs {
  std::vector<float> heat_map = std::vector<float>(2 * 16, -20.0F);
  std::vector<float> offset = std::vector<float>(2 * 16, 0.5F);
  std::vector<float> height = std::vector<float>(16, 1.0F);
  std::vector<float> size = std::vector<float>(3 * 16, 0.0F);
  std::vector<float> rotation = std::vector<float>(2 * 16, 1.0F);
};

std::vector<maps::Box> decode(const nlohmann::json& description, const Outputs& outputs) {
  const OnnxConfig config = config_of(description);
  return decode_dense(
      config, config.heads[0],
      {outputs.heat_map, outputs.offset, outputs.height, outputs.size, outputs.rotation},
      NetworkHeight(config.z, config.sensor_height_m, flat_ground().surface.get()));
}

TEST(DecodeDense, PlacesBoxesByCellAndOffset) {
  Outputs outputs;
  outputs.heat_map[16 + 2 * 4 + 1] = 2.0F;
  outputs.offset[2 * 4 + 1] = -0.25F;
  const auto boxes = decode(bev_description(), outputs);
  ASSERT_THAT(boxes, SizeIs(1));
  EXPECT_EQ(boxes[0].object_class, maps::ObjectClass::kPedestrian);
  EXPECT_THAT(boxes[0].centre, IsNearVector(Eigen::Vector3d(0.75, 0.5, kGround + 1.0), 1e-6));
  EXPECT_THAT(boxes[0].size_m, IsNearVector(Eigen::Vector3d(1.0, 1.0, 1.0), 1e-6));
}

TEST(DecodeDense, KeepsPeaksAndWhatEqualsThemAlone) {
  nlohmann::json description = bev_description();
  description["nms"] = "maxpool";
  Outputs outputs;
  // A slope in the first row; two equal ones in the last; the other class has peaks of its own.
  outputs.heat_map[0] = 3.0F;
  outputs.heat_map[1] = 2.0F;
  outputs.heat_map[12] = outputs.heat_map[13] = 1.0F;
  outputs.heat_map[16 + 1] = 2.5F;
  const auto boxes = decode(description, outputs);
  ASSERT_THAT(boxes, SizeIs(4));
  EXPECT_THAT(boxes[0].centre.head<2>(), IsNearVector(Eigen::Vector2d(0.5, -1.5), 1e-6));
  EXPECT_EQ(boxes[1].object_class, maps::ObjectClass::kPedestrian);
  EXPECT_THAT(boxes[3].centre.head<2>(), IsNearVector(Eigen::Vector2d(1.5, 1.5), 1e-6));
}

TEST(DecodeDense, TakesTheThresholdItself) {
  nlohmann::json description = bev_description();
  description["score_threshold"] = 0.5;
  Outputs outputs;
  outputs.heat_map[3] = 0.0F;
  EXPECT_THAT(decode(description, outputs), IsEmpty()) << "over unknown ground";
  outputs.heat_map[2] = 0.0F;
  outputs.heat_map[1] = -1e-3F;
  EXPECT_THAT(decode(description, outputs), SizeIs(1));
}

TEST(DecodeDense, LeavesOutWhatIsNoBox) {
  nlohmann::json description = bev_description();
  description["sizes"] = "metres";
  for (auto& [tensor, value] : std::vector<std::pair<std::vector<float> Outputs::*, float>>{
           {&Outputs::offset, kNaN},
           {&Outputs::height, std::numeric_limits<float>::infinity()},
           {&Outputs::size, kNaN},
           {&Outputs::size, -1.0F},
           {&Outputs::size, 0.0F},
           {&Outputs::rotation, kNaN},
           {&Outputs::heat_map, kNaN}}) {
    Outputs outputs;
    outputs.size.assign(3 * 16, 2.0F);
    outputs.heat_map[5] = 2.0F;
    ASSERT_THAT(decode(description, outputs), SizeIs(1));
    (outputs.*tensor)[5] = value;
    EXPECT_THAT(decode(description, outputs), IsEmpty()) << value;
  }
}

TEST(DecodeDense, KeepsTheBestOfTooMany) {
  nlohmann::json description = bev_description();
  description["range_m"] = {-100, -100, -1, 0, 100, 3};
  description["stride"] = 1;
  description["heads"][0]["classes"] = nlohmann::json::array({"car"});
  const std::size_t cells = 200 * 400;
  const std::vector<float> zeros(3 * cells, 0.0F);
  std::vector<float> heat(cells, 1.0F);
  heat[cells - 1] = 2.0F;
  const OnnxConfig config = config_of(description);
  const auto boxes =
      decode_dense(config, config.heads[0], {heat, zeros, zeros, zeros, zeros},
                   NetworkHeight(config.z, config.sensor_height_m, flat_ground().surface.get()));
  ASSERT_THAT(boxes, SizeIs(kMostBoxesOfHead));
  // Of equal ones the first, and what is better wherever it stands.
  EXPECT_THAT(boxes.front().centre.head<2>(), IsNearVector(Eigen::Vector2d(-100, -100), 1e-6));
  EXPECT_THAT(boxes.back().centre.head<2>(), IsNearVector(Eigen::Vector2d(-0.5, 99.5), 1e-6));
}

}  // namespace onnx_dense_test
}  // namespace stillmap::mapping

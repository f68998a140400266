#include "detection/onnx/onnx_config.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <string>
#include <utility>
#include <vector>

#include "onnx_network.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace onnx_config_test {

using nlohmann::json;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using namespace test_onnx;

OnnxConfig read(const std::string& text) {
  const test::TemporaryFolder folder;
  return read_onnx_config(folder.write("network.json", text));
}

/// The description of the picture from above with one value replaced. @param at a JSON pointer.
json with(const std::string& at, const json& value) {
  json description = bev_description();
  description[json::json_pointer(at)] = value;
  return description;
}

TEST(OnnxConfig, ReadsEveryKey) {
  const OnnxConfig config = read(bev_description().dump());
  EXPECT_EQ(config.model.filename(), "bev.onnx");
  EXPECT_EQ(config.rows, 8);
  EXPECT_EQ(config.columns, 8);
  EXPECT_EQ(config.stride, 2);
  EXPECT_EQ(config.z, VoxelNextHeight::kGround);
  ASSERT_TRUE(config.bev);
  EXPECT_FALSE(config.pillars);
  EXPECT_THAT(config.bev->channels, ElementsAre(BevChannel::kMaxZ, BevChannel::kLogCount));
  EXPECT_TRUE(config.scores_are_logits && config.sizes_are_logs && config.cosine_first);
  ASSERT_EQ(config.heads.size(), 1U);
  EXPECT_THAT(config.heads[0].classes,
              ElementsAre(maps::ObjectClass::kCar, maps::ObjectClass::kPedestrian));
  EXPECT_EQ(config.score_threshold, 0.3);
  EXPECT_FALSE(config.peaks_only);
}

TEST(OnnxConfig, CountsRowsAlongYAndColumnsAlongX) {
  const OnnxConfig config = read(pillars_description().dump());
  EXPECT_EQ(config.rows, 4);
  EXPECT_EQ(config.columns, 6);
  ASSERT_TRUE(config.pillars);
  EXPECT_EQ(config.pillars->most_points, 4);
}

TEST(OnnxConfig, TakesRangesOfAFewDecimals) {
  json description = with("/range_m", {0, -39.68, -3, 69.12, 39.68, 1});
  description["cell_m"] = {0.16, 0.16};
  const OnnxConfig config = read(description.dump());
  EXPECT_EQ(config.columns, 432);
  EXPECT_EQ(config.rows, 496);
}

TEST(OnnxConfig, NamesWhatIsWrongAndWhere) {
  const std::vector<std::pair<json, std::vector<std::string>>> cases{
      {with("/format", "onnx"), {"config.format", "\"onnx\"", "\"stillmap-onnx\""}},
      {with("/version", 2), {"config.version", "2"}},
      {with("/model", "../bev.onnx"), {"config.model", "a file beside this one"}},
      {with("/colour", 1), {"unknown key \"colour\""}},
      {with("/input/layers", 1), {"config.input", "unknown key \"layers\""}},
      {with("/heads/0/iou", "iou"), {"config.heads[0]", "unknown key \"iou\""}},
      {with("/range_m", {0, 0, 0, 1, 1}), {"config.range_m", "an array of 5", "6"}},
      {with("/range_m/5", -1), {"config.range_m[5]", "more than the least z"}},
      {with("/range_m/3", 4.1), {"config.cell_m[0]", "multiple of the stride 2", "4.1 m"}},
      {with("/range_m/4", 2.5), {"config.cell_m[1]", "multiple of the stride 2", "4.5 m"}},
      {with("/range_m/3", -4), {"config.cell_m[0]"}},
      {with("/cell_m/0", 0), {"config.cell_m[0]", "a number from 0.01"}},
      {with("/cell_m/0", "NaN"), {"config.cell_m[0]", "\"NaN\""}},
      {with("/z", "sea"), {"config.z", "ground, lidar"}},
      {with("/input/kind", "voxels"), {"config.input.kind", "bev, pillars"}},
      {with("/input/channels", {"max_z", "max_z"}), {"config.input.channels[1]", "a name once"}},
      {with("/input/channels", json::array()), {"config.input.channels", "1 to 4"}},
      {with("/input/tensor", ""), {"config.input.tensor", "the name of a tensor"}},
      {with("/stride", 0), {"config.stride", "from 1"}},
      {with("/stride", 1.5), {"config.stride", "a whole number"}},
      {with("/heads", json::array()), {"config.heads"}},
      {with("/heads/0/classes/0", "tank"), {"config.heads[0].classes[0]", "\"tank\""}},
      {with("/score_threshold", 0), {"config.score_threshold", "0.001"}},
      {with("/nms", "none"), {"config.nms", "maxpool, rotated"}},
      {with("/nms_iou", 1.1), {"config.nms_iou"}}};
  for (const auto& [description, texts] : cases)
    EXPECT_THAT([&] { (void)read(description.dump()); }, ThrowsSaying<maps::InputError>(texts))
        << description;
}

TEST(OnnxConfig, NamesAKeyThatIsMissing) {
  const json whole = bev_description();
  for (const auto& [key, value] : whole.items()) {
    json description = whole;
    description.erase(key);
    EXPECT_THAT([&] { (void)read(description.dump()); },
                ThrowsSaying<maps::InputError>({"network.json at config." + key, "nothing"}));
  }
}

TEST(OnnxConfig, RefusesWhatIsNoJsonAndAFileThatIsNotThere) {
  EXPECT_THAT([&] { (void)read("{"); }, ThrowsSaying<maps::InputError>({"network.json", "JSON"}));
  EXPECT_THAT([&] { (void)read("[]"); }, ThrowsSaying<maps::InputError>({"an object"}));
  EXPECT_THAT([&] { (void)read_onnx_config("/nowhere/network.json"); },
              ThrowsSaying<maps::StorageError>({"/nowhere/network.json", "No such file"}));
}

}  // namespace onnx_config_test
}  // namespace stillmap::mapping

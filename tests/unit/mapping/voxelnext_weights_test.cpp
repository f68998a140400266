#include "detection/voxelnext/weights.hpp"

#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <limits>
#include <random>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"
#include "weights_in_memory.hpp"

namespace stillmap::mapping {
namespace voxelnext_weights_test {

using maps::InputError;
using nlohmann::ordered_json;
using test::as_bytes;
using test::SafetensorsParts;
using test::ThrowsSaying;
using test::tiny_config;
using test::tiny_layers;
using test::tiny_weights;

VoxelNextWeights read(const std::string& file) {
  return read_voxelnext_weights(as_bytes(file), "w.safetensors");
}

void expect_refused(const SafetensorsParts& parts, std::vector<std::string> texts) {
  texts.insert(texts.begin(), "w.safetensors");
  EXPECT_THAT([&] { (void)read(parts.bytes()); }, ThrowsSaying<InputError>(texts));
}

/// The config with one value replaced (by its JSON pointer) is refused, and the message names it.
void expect_refused_value(const std::string& pointer, const ordered_json& value,
                          std::vector<std::string> texts) {
  ordered_json config = tiny_config();
  config[ordered_json::json_pointer(pointer)] = value;
  texts.emplace_back("config");
  expect_refused(tiny_weights(config), texts);
}

TEST(VoxelNextWeights, ReadsTheConfig) {
  const VoxelNextConfig config = read(tiny_weights().bytes()).config;
  EXPECT_EQ(config.name, "tiny");
  EXPECT_EQ(config.range_m, (std::array<double, 6>{-8, -8, -1, 8, 8, 3}));
  EXPECT_EQ(config.voxel_m, (std::array<double, 3>{0.5, 0.5, 0.5}));
  EXPECT_EQ(config.z, VoxelNextHeight::kLidar);
  EXPECT_EQ(config.sensor_height_m, 1.8);
  EXPECT_EQ(config.features, (std::vector{VoxelFeature::kX, VoxelFeature::kZero}));
  EXPECT_EQ(config.stages[0].blocks, 1);
  EXPECT_EQ(config.stages[5].channels, 1);
  EXPECT_EQ(config.pruning, (std::array<double, 5>{0.0, 0.5, 0.25, 0.0, 0.0}));
  EXPECT_EQ(config.neck_channels, 2);
  EXPECT_EQ(config.heads.at(0).classes,
            (std::vector<std::optional<maps::ObjectClass>>{maps::ObjectClass::kCar, std::nullopt}));
  EXPECT_EQ(config.branches.size(), 5U);
  EXPECT_EQ(config.calibration.at(1).scale, 2.0);
  EXPECT_EQ(config.calibration.at(1).shift, -0.5);
  EXPECT_EQ(config.nms, VoxelNextSuppression::kRotated);
  EXPECT_EQ(config.score_threshold, (std::vector{0.1, 0.1}));
}

TEST(VoxelNextWeights, ReadsThresholdsByClass) {
  ordered_json config = tiny_config();
  config["score_threshold"] = {0.1, 0.25};
  EXPECT_EQ(read(tiny_weights(config).bytes()).config.score_threshold, (std::vector{0.1, 0.25}));
}

TEST(VoxelNextWeights, ReadsEveryLayerInItsOrder) {
  const VoxelNextWeights weights = read(tiny_weights().bytes());
  EXPECT_EQ(weights.size(), tiny_layers().size());
  float next = 0.0F;
  for (const auto& layer : tiny_layers()) {
    const Convolution& found = weights.layer(layer.name);
    EXPECT_EQ(static_cast<std::size_t>(found.kernel_volume), layer.volume) << layer.name;
    EXPECT_EQ(static_cast<std::size_t>(found.in_channels), layer.in) << layer.name;
    EXPECT_EQ(static_cast<std::size_t>(found.out_channels), layer.out) << layer.name;
    ASSERT_EQ(found.weight.size(), layer.volume * layer.in * layer.out) << layer.name;
    ASSERT_EQ(found.bias.size(), layer.out) << layer.name;
    for (const float value : found.weight) {
      EXPECT_EQ(value, next) << layer.name;
      next += 0.5F;
    }
    for (const float value : found.bias) {
      EXPECT_EQ(value, next) << layer.name;
      next += 0.5F;
    }
  }
}

TEST(VoxelNextWeights, ReadsAFileAndNamesOneThatIsNotThere) {
  const test::TemporaryFolder folder;
  const auto file = folder.write("w.safetensors", tiny_weights().bytes());
  EXPECT_EQ(read_voxelnext_weights(file).config.name, "tiny");
  EXPECT_THAT([&] { (void)read_voxelnext_weights(folder.path() / "none"); },
              ThrowsSaying<maps::StorageError>({"none"}));
  EXPECT_THAT([&] { (void)read_voxelnext_weights(folder.path()); },
              ThrowsSaying<maps::StorageError>({"not a regular file"}));
}

TEST(VoxelNextWeights, RefusesAFileOfAnotherKind) {
  SafetensorsParts parts = tiny_weights();
  parts.header["__metadata__"]["format"] = "pt";
  expect_refused(parts, {"format \"pt\"", "\"stillmap-voxelnext\""});
  parts = tiny_weights();
  parts.header["__metadata__"]["version"] = "2";
  expect_refused(parts, {"version \"2\"", "\"1\""});
  parts = tiny_weights();
  parts.header["__metadata__"].erase("config");
  expect_refused(parts, {"no \"config\""});
  parts.header.erase("__metadata__");
  expect_refused(parts, {"no \"format\""});
}

TEST(VoxelNextWeights, RefusesEveryMissingAndEveryUnknownKey) {
  const ordered_json whole = tiny_config();
  for (const auto& [key, value] : whole.items()) {
    ordered_json config = tiny_config();
    config.erase(key);
    expect_refused(tiny_weights(config), {"config." + key + ": found nothing"});
  }
  expect_refused_value("/colour", 1, {"unknown key \"colour\""});
  expect_refused_value("/stages/2/stride", 2, {"stages[2]", "unknown key \"stride\""});
  expect_refused_value("/heads/0/name", "h", {"heads[0]", "unknown key \"name\""});
}

TEST(VoxelNextWeights, RefusesValuesBeyondTheirBounds) {
  expect_refused_value("/name", "", {"config.name"});
  expect_refused_value("/name", "a\nb", {"config.name"});
  expect_refused_value("/range_m/3", -8.0, {"voxel_m[0]"});
  expect_refused_value("/range_m/3", 1e300, {"range_m[3]"});
  expect_refused_value("/range_m", {0, 0, 0}, {"range_m", "an array of 3"});
  expect_refused_value("/voxel_m/1", 0.0, {"voxel_m[1]"});
  expect_refused_value("/voxel_m/2", -0.5, {"voxel_m[2]"});
  expect_refused_value("/range_m", {-999, -999, -99, 999, 999, 99}, {"voxel_m", "at most 2^29"});
  expect_refused_value("/z", "up", {"config.z", "\"up\"", "ground, lidar"});
  expect_refused_value("/sensor_height_m", "1.8", {"sensor_height_m"});
  expect_refused_value("/features", ordered_json::array(), {"features"});
  expect_refused_value("/features/1", "x", {"features[1]", "a name once"});
  expect_refused_value("/features/1", "colour", {"features[1]", "\"colour\""});
  expect_refused_value("/stages/3/channels", 0, {"stages[3].channels"});
  expect_refused_value("/stages/3/channels", 1.0, {"stages[3].channels", "a whole number"});
  expect_refused_value("/stages/5/channels", 2, {"stages[5].channels", "stage 4"});
  expect_refused_value("/stages/1/kernel", 2, {"stages[1].kernel", "odd"});
  expect_refused_value("/stages/1/blocks", 1e9, {"stages[1].blocks"});
  expect_refused_value("/pruning", {0.0, 0.0}, {"pruning", "an array of 5"});
  expect_refused_value("/pruning/0", -0.1, {"pruning[0]"});
  expect_refused_value("/pruning/4", 1.0, {"pruning[4]", "below 1"});
  expect_refused_value("/neck_channels", 18446744073709551615U, {"neck_channels"});
  expect_refused_value("/head_kernel", 2, {"head_kernel", "1 or 3"});
  expect_refused_value("/heads", ordered_json::array(), {"heads"});
  expect_refused_value("/heads/0/classes/0", "cat", {"heads[0].classes[0]", "\"cat\""});
  expect_refused_value("/branches", {"hm", "center", "dim", "rot"}, {"\"center_z\" among them"});
  expect_refused_value("/iou_rectifier", {0.0}, {"iou_rectifier", "an array of 2"});
  expect_refused_value("/iou_rectifier/0", 0.5, {"iou_rectifier[0]", "without the branch"});
  expect_refused_value("/calibration/0/0", 0.0, {"calibration[0][0]"});
  expect_refused_value("/nms", "none", {"config.nms", "rotated, maxpool"});
  expect_refused_value("/nms_iou", 1.5, {"nms_iou"});
  expect_refused_value("/score_threshold", true, {"score_threshold"});
  expect_refused_value("/score_threshold", {0.1}, {"score_threshold", "an array of 2"});
  expect_refused_value("/score_threshold", {0.1, 1.5}, {"score_threshold[1]"});
}

TEST(VoxelNextWeights, RefusesAConfigThatIsNoJson) {
  SafetensorsParts parts = tiny_weights();
  parts.header["__metadata__"]["config"] = "{\"name\":\"a\",\"name\":\"b\"}";
  expect_refused(parts, {"config", "key \"name\" twice"});
  parts.header["__metadata__"]["config"] = "voxelnext";
  expect_refused(parts, {"config", "no JSON"});
}

TEST(VoxelNextWeights, RefusesMissingExtraAndMisshapenLayers) {
  for (const auto& layer : tiny_layers()) {
    for (const char* part : {".weight", ".bias"}) {
      SafetensorsParts parts = tiny_weights();
      parts.header["renamed"] = parts.header[layer.name + part];
      parts.header.erase(layer.name + part);
      expect_refused(parts, {"\"" + layer.name + part + "\"", "found nothing"});
    }
  }
  SafetensorsParts parts = tiny_weights();
  parts.add("extra", {1}, {0.0F});
  expect_refused(parts, {"tensor \"extra\""});
  parts = tiny_weights();
  parts.header["input.weight"]["shape"] = {27, 1, 2};
  expect_refused(parts, {"\"input.weight\"", "[27, 1, 2]", "[27, 2, 1]"});
}

TEST(VoxelNextWeights, RefusesNumbersThatAreNotFinite) {
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    SafetensorsParts parts = tiny_weights();
    const auto begin = parts.header["neck.out.bias"]["data_offsets"][0].get<std::size_t>();
    std::memcpy(parts.tensor_bytes.data() + begin + 4, &bad, 4);
    expect_refused(parts, {"\"neck.out.bias\"", "as number 1", "finite"});
  }
}

/// What a reader may do with hostile bytes: read them, or refuse them with InputError.
bool reads(const std::string& file) {
  try {
    (void)read(file);
    return true;
  } catch (const InputError&) {
    return false;
  }
}

TEST(VoxelNextWeights, RefusesEveryTruncation) {
  const std::string file = tiny_weights().bytes();
  // Each length in the header and at its seams; of the tensors' bytes each is one more number
  // short.
  for (std::size_t size = 0; size < file.size(); size += 97) {
    EXPECT_FALSE(reads(file.substr(0, size))) << size;
  }
}

TEST(VoxelNextWeights, SurvivesRandomDamage) {
  const std::string valid = tiny_weights().bytes();
  const std::size_t header = valid.size() - tiny_weights().tensor_bytes.size();
  std::mt19937 random(6);
  const auto below = [&](std::size_t end) { return static_cast<std::size_t>(random() % end); };
  int refused = 0;
  for (int round = 0; round < 400; ++round) {
    std::string file = valid;
    for (std::size_t hits = 1 + below(4); hits > 0; --hits) {
      char& byte = file[below(header)];
      byte = below(2) == 0 ? static_cast<char>(byte ^ (1 << below(8)))
                           : "0123456789{}[],:\"-e."[below(20)];
    }
    if (below(4) == 0) file.erase(below(file.size()), 1 + below(64));
    if (below(4) == 0) file.insert(below(header), file.substr(below(header), below(200)));
    refused += reads(file) ? 0 : 1;
  }
  // Most damage shows; the rest hits a figure of the config that may be any.
  EXPECT_GT(refused, 200);
}

}  // namespace voxelnext_weights_test
}  // namespace stillmap::mapping

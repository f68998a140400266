#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::test {

/// A safetensors file put together by hand, for tests of its readers: any part may be made wrong.
struct SafetensorsParts {
  nlohmann::ordered_json header = nlohmann::ordered_json::object();
  std::string tensor_bytes;

  /// Adds floats of a shape behind those that are there.
  void add(const std::string& name, const std::vector<std::size_t>& shape,
           const std::vector<float>& numbers) {
    const std::size_t begin = tensor_bytes.size();
    tensor_bytes.append(reinterpret_cast<const char*>(numbers.data()), 4 * numbers.size());
    header[name] = {
        {"dtype", "F32"}, {"shape", shape}, {"data_offsets", {begin, tensor_bytes.size()}}};
  }

  [[nodiscard]] std::string bytes() const { return with_header(header.dump()); }

  /// The same tensors behind any text as header.
  [[nodiscard]] std::string with_header(const std::string& text) const {
    const std::uint64_t length = text.size();
    std::string bytes(8, '\0');
    std::memcpy(bytes.data(), &length, 8);
    return bytes + text + tensor_bytes;
  }
};

inline std::span<const std::byte> as_bytes(const std::string& text) {
  return std::as_bytes(std::span(text));
}

/// The smallest network there is: one channel everywhere, one block, one head with two classes.
inline nlohmann::ordered_json tiny_config() {
  nlohmann::ordered_json config = {{"name", "tiny"},
                                   {"range_m", {-8.0, -8.0, -1.0, 8.0, 8.0, 3.0}},
                                   {"voxel_m", {0.5, 0.5, 0.5}},
                                   {"z", "lidar"},
                                   {"sensor_height_m", 1.8},
                                   {"features", {"x", "zero"}},
                                   {"stages", nlohmann::ordered_json::array()},
                                   {"pruning", {0.0, 0.5, 0.25, 0.0, 0.0}},
                                   {"neck_channels", 2},
                                   {"head_kernel", 1},
                                   {"heads", {{{"classes", {"car", ""}}}}},
                                   {"yaw", "direction"},
                                   {"branches", {"hm", "center", "center_z", "dim", "rot"}},
                                   {"iou_rectifier", {0.0, 0.0}},
                                   {"calibration", {{1.0, 0.0}, {2.0, -0.5}}},
                                   {"nms", "rotated"},
                                   {"nms_iou", 0.2},
                                   {"score_threshold", 0.1}};
  for (int i = 0; i < 6; ++i) {
    config["stages"].push_back({{"channels", 1}, {"blocks", i == 0 ? 1 : 0}, {"kernel", 3}});
  }
  return config;
}

/// The layers of `tiny_config`: name, kernel volume, channels in and out.
struct TinyLayer {
  std::string name;
  std::size_t volume, in, out;
};
inline std::vector<TinyLayer> tiny_layers() {
  std::vector<TinyLayer> layers = {
      {"input", 27, 2, 1}, {"stage1.block0.conv1", 27, 1, 1}, {"stage1.block0.conv2", 27, 1, 1}};
  for (int i = 2; i <= 6; ++i) layers.push_back({"stage" + std::to_string(i) + ".down", 27, 1, 1});
  layers.push_back({"neck.out", 9, 1, 2});
  layers.push_back({"neck.shared", 9, 2, 2});
  const std::vector<std::pair<std::string, std::size_t>> branches = {
      {"hm", 2}, {"center", 2}, {"center_z", 1}, {"dim", 3}, {"rot", 2}};
  for (const auto& [branch, channels] : branches) {
    layers.push_back({"head0." + branch + ".0", 1, 2, 2});
    layers.push_back({"head0." + branch + ".1", 1, 2, channels});
  }
  return layers;
}

/// A whole, valid file; its numbers count up from 0 in halves, tensor by tensor.
inline SafetensorsParts tiny_weights(const nlohmann::ordered_json& config = tiny_config()) {
  SafetensorsParts parts;
  parts.header["__metadata__"] = {
      {"format", "stillmap-voxelnext"}, {"version", "1"}, {"config", config.dump()}};
  float next = 0.0F;
  const auto numbers = [&](std::size_t count) {
    std::vector<float> values(count);
    for (float& value : values) value = (next += 0.5F) - 0.5F;
    return values;
  };
  for (const TinyLayer& layer : tiny_layers()) {
    parts.add(layer.name + ".weight", {layer.volume, layer.in, layer.out},
              numbers(layer.volume * layer.in * layer.out));
    parts.add(layer.name + ".bias", {layer.out}, numbers(layer.out));
  }
  return parts;
}

}  // namespace stillmap::test

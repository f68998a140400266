#pragma once

#include "detection/voxelnext/weights.hpp"
#include "support/synthetic_world.hpp"

#include <cmath>
#include <string>
#include <utility>

/// Weights of VoxelNeXt that nobody trained.
namespace stillmap::test {

inline mapping::Convolution random_convolution(Random& random, int volume, int in, int out) {
  mapping::Convolution layer{volume, in, out, {}, {}};
  // A few of a kernel's positions are active, so that rows keep their size from layer to layer.
  const double deviation = std::sqrt(2.0 / (in * std::min(volume, 6)));
  const auto floats = [&](std::size_t count, double scale) {
    std::vector<float> values(count);
    for (float& value : values) value = static_cast<float>(scale * random.uniform(-1.7, 1.7));
    return values;
  };
  layer.weight = floats(static_cast<std::size_t>(volume) * static_cast<std::size_t>(in) *
                            static_cast<std::size_t>(out),
                        deviation);
  layer.bias = floats(static_cast<std::size_t>(out), 0.1);
  return layer;
}

enum class Heat { kRandom, kLow };

/// Every layer that the config asks for.
/// @param heat  kLow: logits around the score threshold's, with few peaks that reach it, as those
/// of a network that was trained.
inline mapping::VoxelNextWeights random_weights(mapping::VoxelNextConfig config, std::uint64_t seed,
                                                Heat heat = Heat::kRandom) {
  Random random(seed);
  mapping::VoxelNextWeights out;
  const auto add = [&](const std::string& name, int volume, int in, int channels) {
    out.add(name, random_convolution(random, volume, in, channels));
  };
  int channels = static_cast<int>(config.features.size());
  for (std::size_t i = 0; i < config.stages.size(); ++i) {
    const mapping::VoxelNextStage& stage = config.stages[i];
    const std::string name = "stage" + std::to_string(i + 1);
    const int kernel = i == 0 ? 3 : stage.kernel;
    add(i == 0 ? "input" : name + ".down", kernel * kernel * kernel, channels, stage.channels);
    channels = stage.channels;
    for (int j = 0; j < stage.blocks; ++j) {
      for (const char* which : {".conv1", ".conv2"})
        add(name + ".block" + std::to_string(j) + which, 27, channels, channels);
    }
  }
  add("neck.out", 9, channels, config.neck_channels);
  add("neck.shared", 9, config.neck_channels, config.neck_channels);
  for (std::size_t h = 0; h < config.heads.size(); ++h) {
    for (const mapping::VoxelNextBranch branch : config.branches) {
      const std::string name =
          "head" + std::to_string(h) + "." + std::string(mapping::name_of(branch));
      add(name + ".0", config.head_kernel * config.head_kernel, config.neck_channels,
          config.neck_channels);
      mapping::Convolution last =
          random_convolution(random, 1, config.neck_channels,
                             mapping::channels_of(branch, config.heads[h].classes.size()));
      if (branch == mapping::VoxelNextBranch::kHm && heat == Heat::kLow) {
        for (float& weight : last.weight) weight *= 0.03F;
        for (float& bias : last.bias) bias -= 6.5F;
      }
      out.add(name + ".1", std::move(last));
    }
  }
  out.config = std::move(config);
  return out;
}

}  // namespace stillmap::test

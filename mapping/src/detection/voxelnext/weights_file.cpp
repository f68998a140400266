#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <cmath>
#include <set>

#include "detection/voxelnext/config_text.hpp"
#include "detection/voxelnext/safetensors.hpp"
#include "detection/voxelnext/weights.hpp"

namespace stillmap::mapping {
namespace {

using maps::InputError;

constexpr std::string_view kFormat = "stillmap-voxelnext";
constexpr std::string_view kVersion = "1";
/// The largest published network has 130 MB; a bound before the file is read into memory.
constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{512} << 20U;

/// The layer that a config asks for.
struct Wanted {
  std::string name;
  int kernel_volume = 0;
  int in_channels = 0;
  int out_channels = 0;
};

std::vector<Wanted> backbone_layers(const VoxelNextConfig& config) {
  std::vector<Wanted> wanted;
  int channels = config.stages[0].channels;
  wanted.push_back({"input", 27, static_cast<int>(config.features.size()), channels});
  for (std::size_t i = 0; i < config.stages.size(); ++i) {
    const VoxelNextStage& stage = config.stages[i];
    const std::string name = fmt::format("stage{}.", i + 1);
    if (i > 0) {
      const int volume = stage.kernel * stage.kernel * stage.kernel;
      wanted.push_back({name + "down", volume, channels, stage.channels});
      channels = stage.channels;
    }
    for (int j = 0; j < stage.blocks; ++j) {
      const std::string block = fmt::format("{}block{}.conv", name, j);
      wanted.push_back({block + "1", 27, channels, channels});
      wanted.push_back({block + "2", 27, channels, channels});
    }
  }
  return wanted;
}

std::vector<Wanted> wanted_layers(const VoxelNextConfig& config) {
  std::vector<Wanted> wanted = backbone_layers(config);
  const int neck = config.neck_channels;
  wanted.push_back({"neck.out", 9, config.stages[3].channels, neck});
  wanted.push_back({"neck.shared", 9, neck, neck});
  for (std::size_t h = 0; h < config.heads.size(); ++h) {
    for (const VoxelNextBranch branch : config.branches) {
      const std::string name = fmt::format("head{}.{}.", h, name_of(branch));
      const int out = channels_of(branch, config.heads[h].classes.size());
      wanted.push_back({name + "0", config.head_kernel * config.head_kernel, neck, neck});
      wanted.push_back({name + "1", 1, neck, out});
    }
  }
  return wanted;
}

std::vector<float> numbers_of(const Safetensors& tensors, const std::string& tensor,
                              const std::vector<std::size_t>& shape, const std::string& name) {
  const std::string at = fmt::format("{} at tensor {}", name, maps::described(tensor));
  const auto text = [](const std::vector<std::size_t>& sizes) {
    return fmt::format("[{}]", fmt::join(sizes, ", "));
  };
  const auto found = tensors.tensors.find(tensor);
  if (found == tensors.tensors.end()) {
    throw InputError(at, "nothing", "numbers of shape " + text(shape));
  }
  if (found->second.shape != shape) {
    throw InputError(at, "shape " + text(found->second.shape), text(shape) + ", by the config");
  }
  std::vector<float> numbers = found->second.floats();
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (std::isfinite(numbers[i])) continue;
    throw InputError(at, fmt::format("{} as number {}", numbers[i], i), "finite numbers");
  }
  return numbers;
}

const std::string& metadata(const Safetensors& tensors, const std::string& key,
                            const std::string& name) {
  const auto found = tensors.metadata.find(key);
  if (found != tensors.metadata.end()) return found->second;
  throw InputError(name + " at __metadata__", "no " + maps::described(key),
                   "a weights file of format " + std::string(kFormat));
}

void check_metadata(const Safetensors& tensors, const std::string& name) {
  const std::string at = name + " at __metadata__";
  const std::string& format = metadata(tensors, "format", name);
  if (format != kFormat) {
    throw InputError(at, "format " + maps::described(format), maps::described(kFormat));
  }
  const std::string& version = metadata(tensors, "version", name);
  if (version != kVersion) {
    throw InputError(at, "version " + maps::described(version), maps::described(kVersion));
  }
}

}  // namespace

VoxelNextWeights read_voxelnext_weights(std::span<const std::byte> bytes, const std::string& name) {
  const Safetensors tensors = parse_safetensors(bytes, name);
  check_metadata(tensors, name);
  VoxelNextWeights weights;
  weights.config = parse_voxelnext_config(metadata(tensors, "config", name), name);
  std::set<std::string, std::less<>> known;
  for (const Wanted& layer : wanted_layers(weights.config)) {
    const auto size = [](int channels) { return static_cast<std::size_t>(channels); };
    const std::string weight = layer.name + ".weight";
    const std::string bias = layer.name + ".bias";
    Convolution convolution{layer.kernel_volume, layer.in_channels, layer.out_channels, {}, {}};
    convolution.weight = numbers_of(
        tensors, weight,
        {size(layer.kernel_volume), size(layer.in_channels), size(layer.out_channels)}, name);
    convolution.bias = numbers_of(tensors, bias, {size(layer.out_channels)}, name);
    weights.add(layer.name, std::move(convolution));
    known.insert({weight, bias});
  }
  for (const auto& [tensor, view] : tensors.tensors) {
    if (known.contains(tensor)) continue;
    throw InputError(name, "tensor " + maps::described(tensor),
                     "only those that its config asks for");
  }
  return weights;
}

VoxelNextWeights read_voxelnext_weights(const std::filesystem::path& file) {
  const std::string bytes = maps::read_text(file, kMaxFileBytes);
  return read_voxelnext_weights(std::as_bytes(std::span(bytes)), file.string());
}

}  // namespace stillmap::mapping

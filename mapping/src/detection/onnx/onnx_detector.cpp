#include "detection/onnx/onnx_detector.hpp"

#include "detection/bev_overlap.hpp"
#include "detection/onnx/dense_decoding.hpp"
#include "detection/onnx/dense_input.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <utility>

namespace stillmap::mapping {

namespace {

using Shape = std::vector<std::int64_t>;

/// Whether a tensor of the model can have a shape. A size of -1 in `wanted` must be open in the
/// model; one without any sizes says nothing.
bool fits(const Shape& of_model, const Shape& wanted) {
  if (of_model.empty()) return true;
  return std::equal(
      of_model.begin(), of_model.end(), wanted.begin(), wanted.end(),
      [](std::int64_t found, std::int64_t size) { return found == size || found == -1; });
}

const OnnxTensorType& tensor_named(const OnnxConfig& config,
                                   const std::vector<OnnxTensorType>& tensors,
                                   const std::string& name, const std::string& kind) {
  std::string names;
  for (const OnnxTensorType& tensor : tensors) {
    if (tensor.name == name) return tensor;
    names += (names.empty() ? "'" : ", '") + tensor.name + "'";
  }
  throw maps::InputError(config.model.string(), kind + "s " + names,
                         "'" + name + "' among them, as " + config.name + " says");
}

void check_type(const OnnxConfig& config, const OnnxTensorType& tensor, bool whole_numbers,
                const Shape& wanted, const std::string& kind) {
  const bool element = tensor.element == OnnxElement::kFloat ||
                       (whole_numbers && tensor.element != OnnxElement::kOther);
  if (element && fits(tensor.shape, wanted)) return;
  throw maps::InputError(
      config.model.string(),
      kind + " '" + tensor.name + "' as " + text_of(tensor.element, tensor.shape),
      text_of(whole_numbers ? OnnxElement::kInt64 : OnnxElement::kFloat, wanted));
}

void check_inputs(const OnnxConfig& config, const std::vector<OnnxTensorType>& inputs) {
  const auto check = [&](const std::string& name, bool whole_numbers, const Shape& wanted) {
    check_type(config, tensor_named(config, inputs, name, "input"), whole_numbers, wanted, "input");
  };
  if (config.bev) {
    check(config.bev->tensor, false,
          {1, std::ssize(config.bev->channels), config.rows, config.columns});
  } else {
    check(config.pillars->points, false,
          {-1, config.pillars->most_points, std::ssize(config.pillars->features)});
    check(config.pillars->cells, true, {-1, 4});
    check(config.pillars->counts, true, {-1});
  }
  const std::size_t wanted = config.bev ? 1 : 3;
  if (inputs.size() != wanted)
    throw maps::InputError(config.model.string(), std::to_string(inputs.size()) + " inputs",
                           "the " + std::to_string(wanted) + " that " + config.name + " names");
}

/// Names and shapes of a head's tensors in the order of HeadOutputs.
std::vector<std::pair<std::string, Shape>> tensors_of(const OnnxConfig& config,
                                                      const OnnxHead& head) {
  const auto shape = [&](std::int64_t channels) {
    return Shape{1, channels, config.rows / config.stride, config.columns / config.stride};
  };
  return {{head.heat_map, shape(std::ssize(head.classes))},
          {head.offset, shape(2)},
          {head.height, shape(1)},
          {head.size, shape(3)},
          {head.rotation, shape(2)}};
}

/// Whole numbers in the type that the model takes.
OnnxTensor as_taken(OnnxTensor tensor, const std::vector<OnnxTensorType>& inputs) {
  const auto input = std::find_if(inputs.begin(), inputs.end(), [&](const OnnxTensorType& type) {
    return type.name == tensor.name;
  });
  const auto& whole = std::get<std::vector<std::int64_t>>(tensor.values);
  const auto convert = [&]<typename T>(T) {
    std::vector<T> values(whole.size());
    std::transform(whole.begin(), whole.end(), values.begin(),
                   [](std::int64_t value) { return static_cast<T>(value); });
    return values;
  };
  if (input->element == OnnxElement::kInt32)
    tensor.values = convert(std::int32_t{});
  else if (input->element == OnnxElement::kFloat)
    tensor.values = convert(float{});
  return tensor;
}

/// Empty when no point is in the range.
std::vector<OnnxTensor> inputs_of(const OnnxConfig& config, const OnnxSession& session,
                                  const maps::PointCloud& cloud, const NetworkHeight& z) {
  std::vector<OnnxTensor> inputs;
  if (config.bev) {
    inputs.push_back(bev_tensor(config, cloud, z));
    return inputs;
  }
  Pillars pillars = pillar_tensors(config, cloud, z);
  if (pillars.counts.shape.front() == 0) return inputs;
  inputs.push_back(std::move(pillars.points));
  inputs.push_back(as_taken(std::move(pillars.cells), session.inputs()));
  inputs.push_back(as_taken(std::move(pillars.counts), session.inputs()));
  return inputs;
}

}  // namespace

OnnxDetector::OnnxDetector(const std::filesystem::path& description, const std::string& library)
    : config_(read_onnx_config(description)), session_(library, config_.model) {
  check_inputs(config_, session_.inputs());
  for (const OnnxHead& head : config_.heads)
    for (const auto& [name, shape] : tensors_of(config_, head))
      check_type(config_, tensor_named(config_, session_.outputs(), name, "output"), false, shape,
                 "output");
}

std::vector<maps::Box> OnnxDetector::detect(const maps::Scan& scan,
                                            const GroundResult& ground) const {
  const NetworkHeight z(config_.z, config_.sensor_height_m, ground.surface.get());
  std::vector<OnnxTensor> inputs = inputs_of(config_, session_, scan.cloud, z);
  if (inputs.empty()) return {};
  std::vector<std::string> names;
  std::vector<Shape> shapes;
  for (const OnnxHead& head : config_.heads) {
    for (auto& [name, shape] : tensors_of(config_, head)) {
      names.push_back(std::move(name));
      shapes.push_back(std::move(shape));
    }
  }
  const std::vector<OnnxTensor> outputs = session_.run(std::move(inputs), names);
  std::vector<std::span<const float>> values;
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    if (outputs[i].shape != shapes[i])
      throw maps::InputError(
          config_.model.string(),
          "output '" + names[i] + "' as " + text_of(OnnxElement::kFloat, outputs[i].shape),
          text_of(OnnxElement::kFloat, shapes[i]));
    values.emplace_back(std::get<std::vector<float>>(outputs[i].values));
  }
  std::vector<maps::Box> boxes;
  for (std::size_t h = 0; h < config_.heads.size(); ++h) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(5 * h);
    std::ranges::move(
        decode_dense(config_, config_.heads[h], {at[0], at[1], at[2], at[3], at[4]}, z),
        std::back_inserter(boxes));
  }
  if (config_.peaks_only) return boxes;
  return suppress_overlaps(std::move(boxes), config_.nms_iou);
}

}  // namespace stillmap::mapping

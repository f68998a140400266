#include "detection/onnx/onnx_session.hpp"

#include "detection/onnx/ort_api.hpp"

#include <stillmap/maps/error.hpp>

#include <dlfcn.h>

#include <cstdlib>
#include <functional>
#include <numeric>
#include <stdexcept>
#include <string_view>
#include <utility>

namespace stillmap::mapping {

namespace {

using maps::InputError;

template <typename T>
using Owned = std::unique_ptr<T, void (*)(T*)>;

const ort::Api& load_api(const std::string& library) {
  const std::string expected = "ONNX Runtime 1.x as " + std::string("libonnxruntime.so.1") +
                               " where the loader looks, or its path in STILLMAP_ONNXRUNTIME";
  // Never closed: threads and statics of the library outlive its last session.
  void* const handle = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr) {
    const char* const reason = dlerror();
    throw InputError(library, reason == nullptr ? "no shared library" : reason, expected);
  }
  using GetApiBase = const ort::ApiBase* (*)();
  const auto get_base = reinterpret_cast<GetApiBase>(dlsym(handle, "OrtGetApiBase"));
  if (get_base == nullptr) throw InputError(library, "no symbol OrtGetApiBase", expected);
  const ort::ApiBase* const base = get_base();
  const ort::Api* const api = base == nullptr ? nullptr : base->GetApi(ort::kApiVersion);
  if (api == nullptr) {
    throw InputError(library,
                     "a version (" +
                         std::string(base == nullptr ? "unknown" : base->GetVersionString()) +
                         ") that has no C API " + std::to_string(ort::kApiVersion),
                     expected);
  }
  return *api;
}

OnnxElement element_of(int type) {
  switch (type) {
    case ort::kFloat:
      return OnnxElement::kFloat;
    case ort::kInt32:
      return OnnxElement::kInt32;
    case ort::kInt64:
      return OnnxElement::kInt64;
    default:
      return OnnxElement::kOther;
  }
}

}  // namespace

/// Calls into the table, with a failed status as an exception.
class OnnxCalls {
 public:
  OnnxCalls(const ort::Api& api, std::string name) : api_(api), name_(std::move(name)) {}

  void check(ort::Status* status, std::string_view expected) const {
    if (status == nullptr) return;
    const Owned<ort::Status> owned(status, api_.ReleaseStatus);
    throw InputError(name_, api_.GetErrorMessage(status), std::string(expected));
  }
  [[nodiscard]] OnnxTensorType type_of(const ort::TensorInfo* info) const {
    int element = 0;
    check(api_.GetTensorElementType(info, &element), kTensor);
    std::size_t dimensions = 0;
    check(api_.GetDimensionsCount(info, &dimensions), kTensor);
    OnnxTensorType type{{}, element_of(element), std::vector<std::int64_t>(dimensions)};
    check(api_.GetDimensions(info, type.shape.data(), dimensions), kTensor);
    return type;
  }
  [[nodiscard]] const ort::Api& api() const { return api_; }

  static constexpr std::string_view kTensor = "a tensor";

 private:
  const ort::Api& api_;
  std::string name_;
};

namespace {

using GetType = ort::Status* (*)(const ort::Session*, std::size_t, ort::TypeInfo**);
using GetName = ort::Status* (*)(const ort::Session*, std::size_t, ort::Allocator*, char**);

std::vector<OnnxTensorType> types_of(const OnnxCalls& calls, const ort::Session* session,
                                     std::size_t count, GetType get_type, GetName get_name) {
  const ort::Api& api = calls.api();
  ort::Allocator* allocator = nullptr;
  calls.check(api.GetAllocatorWithDefaultOptions(&allocator), "an allocator");
  std::vector<OnnxTensorType> types;
  for (std::size_t i = 0; i < count; ++i) {
    ort::TypeInfo* info = nullptr;
    calls.check(get_type(session, i, &info), "a typed tensor");
    const Owned<ort::TypeInfo> owned(info, api.ReleaseTypeInfo);
    const ort::TensorInfo* tensor = nullptr;
    calls.check(api.CastTypeInfoToTensorInfo(info, &tensor), OnnxCalls::kTensor);
    OnnxTensorType type = tensor == nullptr ? OnnxTensorType{} : calls.type_of(tensor);
    char* name = nullptr;
    calls.check(get_name(session, i, allocator, &name), "a name");
    type.name = name;
    calls.check(api.AllocatorFree(allocator, name), "to free it");
    types.push_back(std::move(type));
  }
  return types;
}

}  // namespace

std::string onnx_runtime_library() {
  const char* const path = std::getenv("STILLMAP_ONNXRUNTIME");
  return path != nullptr && *path != '\0' ? path : "libonnxruntime.so.1";
}

std::string text_of(OnnxElement element, const std::vector<std::int64_t>& shape) {
  constexpr std::string_view kNames[] = {"float", "int32", "int64", "other type"};
  std::string text(kNames[static_cast<std::size_t>(element)]);
  text += " [";
  for (std::size_t i = 0; i < shape.size(); ++i)
    text += (i == 0 ? "" : ", ") + std::to_string(shape[i]);
  return text + "]";
}

struct OnnxSession::Handles {
  OnnxCalls calls;
  Owned<ort::Env> env{nullptr, calls.api().ReleaseEnv};
  Owned<ort::Session> session{nullptr, calls.api().ReleaseSession};
  Owned<ort::MemoryInfo> memory{nullptr, calls.api().ReleaseMemoryInfo};

  void open(const std::string& model) {
    const ort::Api& api = calls.api();
    ort::Env* new_env = nullptr;
    calls.check(api.CreateEnv(ort::kLogFatalOnly, "stillmap", &new_env), "an environment");
    env.reset(new_env);
    ort::SessionOptions* new_options = nullptr;
    calls.check(api.CreateSessionOptions(&new_options), "options");
    const Owned<ort::SessionOptions> options(new_options, api.ReleaseSessionOptions);
    calls.check(api.SetIntraOpNumThreads(new_options, 1), "one thread");
    calls.check(api.SetSessionGraphOptimizationLevel(new_options, ort::kOptimizeAll),
                "an optimizer");
    ort::Session* new_session = nullptr;
    calls.check(api.CreateSession(env.get(), model.c_str(), new_options, &new_session),
                "a model that this ONNX Runtime can run");
    session.reset(new_session);
    ort::MemoryInfo* new_memory = nullptr;
    calls.check(api.CreateCpuMemoryInfo(ort::kDeviceAllocator, ort::kDefaultMemory, &new_memory),
                "memory");
    memory.reset(new_memory);
  }

  [[nodiscard]] Owned<ort::Value> value_of(OnnxTensor& tensor) const {
    ort::Value* value = nullptr;
    std::visit(
        [&](auto& values) {
          using T = typename std::decay_t<decltype(values)>::value_type;
          const int element = std::is_same_v<T, float>          ? ort::kFloat
                              : std::is_same_v<T, std::int32_t> ? ort::kInt32
                                                                : ort::kInt64;
          const auto wanted = std::accumulate(tensor.shape.begin(), tensor.shape.end(),
                                              std::int64_t{1}, std::multiplies<>());
          if (wanted != static_cast<std::int64_t>(values.size()))
            throw std::invalid_argument("tensor '" + tensor.name + "': found " +
                                        std::to_string(values.size()) + " values, expected " +
                                        std::to_string(wanted));
          calls.check(calls.api().CreateTensorWithDataAsOrtValue(
                          memory.get(), values.data(), values.size() * sizeof(T),
                          tensor.shape.data(), tensor.shape.size(), element, &value),
                      OnnxCalls::kTensor);
        },
        tensor.values);
    return {value, calls.api().ReleaseValue};
  }

  [[nodiscard]] OnnxTensor tensor_of(ort::Value* value, const std::string& model,
                                     const std::string& name) const {
    ort::TensorInfo* info = nullptr;
    calls.check(calls.api().GetTensorTypeAndShape(value, &info), OnnxCalls::kTensor);
    const Owned<ort::TensorInfo> owned(info, calls.api().ReleaseTensorInfo);
    OnnxTensorType type = calls.type_of(info);
    if (type.element != OnnxElement::kFloat)
      throw InputError(model, "output '" + name + "' as " + text_of(type.element, type.shape),
                       "floats");
    const auto count =
        std::accumulate(type.shape.begin(), type.shape.end(), std::int64_t{1}, std::multiplies<>());
    void* data = nullptr;
    calls.check(calls.api().GetTensorMutableData(value, &data), "its numbers");
    const auto* const first = static_cast<const float*>(data);
    return {name, std::move(type.shape), std::vector<float>(first, first + count)};
  }
};

OnnxSession::OnnxSession(const std::string& library, const std::filesystem::path& model)
    : name_(model.string()) {
  // The library's own message for this differs from version to version.
  if (!std::filesystem::is_regular_file(model))
    throw InputError(name_, "no file", "an ONNX model: check the path in onnx:FILE");
  handles_ = std::make_unique<Handles>(Handles{OnnxCalls(load_api(library), name_)});
  handles_->open(name_);
  const OnnxCalls& calls = handles_->calls;
  const ort::Session* const session = handles_->session.get();
  std::size_t count = 0;
  calls.check(calls.api().SessionGetInputCount(session, &count), "inputs");
  inputs_ = types_of(calls, session, count, calls.api().SessionGetInputTypeInfo,
                     calls.api().SessionGetInputName);
  calls.check(calls.api().SessionGetOutputCount(session, &count), "outputs");
  outputs_ = types_of(calls, session, count, calls.api().SessionGetOutputTypeInfo,
                      calls.api().SessionGetOutputName);
}

OnnxSession::~OnnxSession() = default;

std::vector<OnnxTensor> OnnxSession::run(std::vector<OnnxTensor> inputs,
                                         const std::vector<std::string>& outputs) const {
  const Handles& handles = *handles_;
  std::vector<Owned<ort::Value>> owned;
  std::vector<const ort::Value*> values;
  std::vector<const char*> input_names, output_names;
  for (OnnxTensor& input : inputs) {
    owned.push_back(handles.value_of(input));
    values.push_back(owned.back().get());
    input_names.push_back(input.name.c_str());
  }
  for (const std::string& name : outputs) output_names.push_back(name.c_str());
  std::vector<ort::Value*> raw(outputs.size(), nullptr);
  ort::Status* const status =
      handles.calls.api().Run(handles.session.get(), nullptr, input_names.data(), values.data(),
                              values.size(), output_names.data(), output_names.size(), raw.data());
  std::vector<Owned<ort::Value>> results;
  for (ort::Value* value : raw) results.emplace_back(value, handles.calls.api().ReleaseValue);
  handles.calls.check(status, "inputs that the model can run on");
  std::vector<OnnxTensor> tensors;
  for (std::size_t i = 0; i < outputs.size(); ++i)
    tensors.push_back(handles.tensor_of(results[i].get(), name_, outputs[i]));
  return tensors;
}

}  // namespace stillmap::mapping

#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <variant>
#include <vector>

namespace stillmap::mapping {

/// Where ONNX Runtime is looked for: the file that STILLMAP_ONNXRUNTIME names, or else what the
/// loader finds as `libonnxruntime.so.1`.
[[nodiscard]] std::string onnx_runtime_library();

enum class OnnxElement { kFloat, kInt32, kInt64, kOther };

/// What a model says of a tensor that goes in or comes out.
struct OnnxTensorType {
  std::string name;
  OnnxElement element = OnnxElement::kOther;
  /// -1 where the model leaves the size open.
  std::vector<std::int64_t> shape;
};

/// "float [1, 3, -1, 200]".
[[nodiscard]] std::string text_of(OnnxElement element, const std::vector<std::int64_t>& shape);

struct OnnxTensor {
  std::string name;
  std::vector<std::int64_t> shape;
  /// Row-major, as many as the shape says.
  std::variant<std::vector<float>, std::vector<std::int32_t>, std::vector<std::int64_t>> values;
};

/// A model that is run by ONNX Runtime on the CPU. The library is loaded at run time and stays
/// loaded until the program ends.
class OnnxSession {
 public:
  /// @param library  path, or a name that the loader looks for.
  /// @throws maps::InputError when there is no such library, it is no ONNX Runtime or does not know
  ///         the C API's version 1, or when the model is missing or refused by it.
  OnnxSession(const std::string& library, const std::filesystem::path& model);
  ~OnnxSession();
  OnnxSession(const OnnxSession&) = delete;
  OnnxSession& operator=(const OnnxSession&) = delete;

  [[nodiscard]] const std::vector<OnnxTensorType>& inputs() const { return inputs_; }
  [[nodiscard]] const std::vector<OnnxTensorType>& outputs() const { return outputs_; }

  /// @param inputs   each with as many values as its shape says.
  /// @param outputs  names of tensors of floats.
  /// @return in the order of `outputs`.
  /// @throws maps::InputError with the library's message, or for an output that is not of floats.
  /// @note Safe from several threads. One thread a call, so that the same input gives the same
  /// bits on the same machine.
  [[nodiscard]] std::vector<OnnxTensor> run(std::vector<OnnxTensor> inputs,
                                            const std::vector<std::string>& outputs) const;

 private:
  struct Handles;
  std::string name_;
  std::unique_ptr<Handles> handles_;
  std::vector<OnnxTensorType> inputs_, outputs_;
};

}  // namespace stillmap::mapping

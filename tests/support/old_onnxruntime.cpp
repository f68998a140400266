// A library that looks like ONNX Runtime and knows none of the versions of its C API.

#include <cstdint>

namespace {

struct ApiBase {
  const void* (*get_api)(std::uint32_t version);
  const char* (*version)();
};

const ApiBase kBase{[](std::uint32_t) -> const void* { return nullptr; },
                    []() -> const char* { return "0.3.1"; }};

}  // namespace

extern "C" const ApiBase* OrtGetApiBase() { return &kBase; }

#pragma once

#include <cstddef>
#include <cstdint>

/// The entries of ONNX Runtime's C API that are used here, declared by their places in its table,
/// so that neither its header nor its library is needed to build.
///
/// @see onnxruntime_c_api.h (`struct OrtApi`) for signatures and order, and "Rules on how to add a
///      new Ort API version" in onnxruntime_c_api.cc: "NEVER remove or rearrange the members", new
///      ones go to the end, and the table of API version 1 ends for ever with entry 101 ("Size of
///      version 1 API cannot change"). All that is used lies within these; the places are those of
///      the headers of API versions 1 and 12.
namespace stillmap::mapping::ort {

struct Env;
struct Status;
struct MemoryInfo;
struct Session;
struct SessionOptions;
struct Value;
struct TypeInfo;
struct TensorInfo;
struct Allocator;

/// Version of the table that is asked for. Libraries give it out for ever.
inline constexpr std::uint32_t kApiVersion = 1;
/// ORT_LOGGING_LEVEL_FATAL: errors come back as a status, and a library does not print.
inline constexpr int kLogFatalOnly = 4;
/// ORT_ENABLE_ALL.
inline constexpr int kOptimizeAll = 99;
/// OrtDeviceAllocator and OrtMemTypeDefault: plain memory that the caller owns.
inline constexpr int kDeviceAllocator = 0;
inline constexpr int kDefaultMemory = 0;
/// ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT, _INT32, _INT64.
inline constexpr int kFloat = 1;
inline constexpr int kInt32 = 6;
inline constexpr int kInt64 = 7;

using Unused = void (*)();

// NOLINTBEGIN(readability-identifier-naming): names of ONNX Runtime's C API
struct Api {
  Unused unused_0[2];
  const char* (*GetErrorMessage)(const Status*);
  Status* (*CreateEnv)(int severity, const char* log_id, Env**);
  Unused unused_4[3];
  Status* (*CreateSession)(const Env*, const char* path, const SessionOptions*, Session**);
  Unused unused_8;
  Status* (*Run)(Session*, const void* run_options, const char* const* input_names,
                 const Value* const* inputs, std::size_t input_count,
                 const char* const* output_names, std::size_t output_count, Value** outputs);
  Status* (*CreateSessionOptions)(SessionOptions**);
  Unused unused_11[12];
  Status* (*SetSessionGraphOptimizationLevel)(SessionOptions*, int level);
  Status* (*SetIntraOpNumThreads)(SessionOptions*, int threads);
  Unused unused_25[5];
  Status* (*SessionGetInputCount)(const Session*, std::size_t*);
  Status* (*SessionGetOutputCount)(const Session*, std::size_t*);
  Unused unused_32;
  Status* (*SessionGetInputTypeInfo)(const Session*, std::size_t index, TypeInfo**);
  Status* (*SessionGetOutputTypeInfo)(const Session*, std::size_t index, TypeInfo**);
  Unused unused_35;
  Status* (*SessionGetInputName)(const Session*, std::size_t index, Allocator*, char**);
  Status* (*SessionGetOutputName)(const Session*, std::size_t index, Allocator*, char**);
  Unused unused_38[11];
  Status* (*CreateTensorWithDataAsOrtValue)(const MemoryInfo*, void* data, std::size_t bytes,
                                            const std::int64_t* shape, std::size_t dimensions,
                                            int element_type, Value**);
  Unused unused_50;
  Status* (*GetTensorMutableData)(Value*, void**);
  Unused unused_52[3];
  /// Null for what is no tensor; the result belongs to the TypeInfo.
  Status* (*CastTypeInfoToTensorInfo)(const TypeInfo*, const TensorInfo**);
  Unused unused_56[4];
  Status* (*GetTensorElementType)(const TensorInfo*, int*);
  Status* (*GetDimensionsCount)(const TensorInfo*, std::size_t*);
  Status* (*GetDimensions)(const TensorInfo*, std::int64_t*, std::size_t);
  Unused unused_63[2];
  Status* (*GetTensorTypeAndShape)(const Value*, TensorInfo**);
  Unused unused_66[3];
  Status* (*CreateCpuMemoryInfo)(int allocator_type, int memory_type, MemoryInfo**);
  Unused unused_70[6];
  Status* (*AllocatorFree)(Allocator*, void*);
  Unused unused_77;
  /// The library's own; not to be released.
  Status* (*GetAllocatorWithDefaultOptions)(Allocator**);
  Unused unused_79[13];
  void (*ReleaseEnv)(Env*);
  void (*ReleaseStatus)(Status*);
  void (*ReleaseMemoryInfo)(MemoryInfo*);
  void (*ReleaseSession)(Session*);
  void (*ReleaseValue)(Value*);
  Unused unused_97;
  void (*ReleaseTypeInfo)(TypeInfo*);
  void (*ReleaseTensorInfo)(TensorInfo*);
  void (*ReleaseSessionOptions)(SessionOptions*);
};

/// What the library's one symbol, `OrtGetApiBase`, returns.
struct ApiBase {
  /// Null when the library does not know this version.
  const Api* (*GetApi)(std::uint32_t version);
  const char* (*GetVersionString)();
};
// NOLINTEND(readability-identifier-naming)

/// Place of an entry by its offset.
constexpr std::size_t place(std::size_t offset) { return offset / sizeof(Unused); }

static_assert(place(offsetof(Api, GetErrorMessage)) == 2);
static_assert(place(offsetof(Api, CreateEnv)) == 3);
static_assert(place(offsetof(Api, CreateSession)) == 7);
static_assert(place(offsetof(Api, Run)) == 9);
static_assert(place(offsetof(Api, CreateSessionOptions)) == 10);
static_assert(place(offsetof(Api, SetSessionGraphOptimizationLevel)) == 23);
static_assert(place(offsetof(Api, SetIntraOpNumThreads)) == 24);
static_assert(place(offsetof(Api, SessionGetInputCount)) == 30);
static_assert(place(offsetof(Api, SessionGetOutputCount)) == 31);
static_assert(place(offsetof(Api, SessionGetInputTypeInfo)) == 33);
static_assert(place(offsetof(Api, SessionGetOutputTypeInfo)) == 34);
static_assert(place(offsetof(Api, SessionGetInputName)) == 36);
static_assert(place(offsetof(Api, SessionGetOutputName)) == 37);
static_assert(place(offsetof(Api, CreateTensorWithDataAsOrtValue)) == 49);
static_assert(place(offsetof(Api, GetTensorMutableData)) == 51);
static_assert(place(offsetof(Api, CastTypeInfoToTensorInfo)) == 55);
static_assert(place(offsetof(Api, GetTensorElementType)) == 60);
static_assert(place(offsetof(Api, GetDimensionsCount)) == 61);
static_assert(place(offsetof(Api, GetDimensions)) == 62);
static_assert(place(offsetof(Api, GetTensorTypeAndShape)) == 65);
static_assert(place(offsetof(Api, CreateCpuMemoryInfo)) == 69);
static_assert(place(offsetof(Api, AllocatorFree)) == 76);
static_assert(place(offsetof(Api, GetAllocatorWithDefaultOptions)) == 78);
static_assert(place(offsetof(Api, ReleaseEnv)) == 92);
static_assert(place(offsetof(Api, ReleaseStatus)) == 93);
static_assert(place(offsetof(Api, ReleaseMemoryInfo)) == 94);
static_assert(place(offsetof(Api, ReleaseSession)) == 95);
static_assert(place(offsetof(Api, ReleaseValue)) == 96);
static_assert(place(offsetof(Api, ReleaseTypeInfo)) == 98);
static_assert(place(offsetof(Api, ReleaseTensorInfo)) == 99);
static_assert(place(offsetof(Api, ReleaseSessionOptions)) == 100);

}  // namespace stillmap::mapping::ort

#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Type of a tensor's numbers; the format knows more, a network of ours needs no other.
enum class TensorType { kF32, kF16 };

/// One tensor of a file, still as its bytes.
struct TensorView {
  TensorType type = TensorType::kF32;
  /// Row-major; empty for a single number.
  std::vector<std::size_t> shape;
  /// Little-endian, product of `shape` numbers, of any alignment; lives as long as the file's
  /// bytes.
  std::span<const std::byte> bytes;

  [[nodiscard]] std::size_t count() const;
  /// All numbers as float, halves widened exactly; infinities and NaN come through as they are.
  [[nodiscard]] std::vector<float> floats() const;
};

/// What a safetensors file holds.
struct Safetensors {
  std::map<std::string, std::string, std::less<>> metadata;
  std::map<std::string, TensorView, std::less<>> tensors;
};

/// A header of a network with a thousand tensors is a tenth of this; JSON grows in memory.
inline constexpr std::uint64_t kMaxHeaderBytes = 1U << 20U;

/// Reads the header of a safetensors file: an 8-byte little-endian length, a JSON object of that
/// many bytes ({name: {dtype, shape, data_offsets}}, "__metadata__": texts), then the tensors'
/// bytes. Nothing is believed: the tensors must cover the bytes after the header without gap or
/// overlap, each as long as its shape and type say. Stricter than the format in three things: F32
/// and F16 alone, a header of at most kMaxHeaderBytes, no key twice.
/// @param bytes the whole file; the result points into it.
/// @param name  what stands in messages, mostly the file's path.
/// @throws maps::InputError naming it, what was found and what was expected.
/// @see https://github.com/huggingface/safetensors, "Format".
[[nodiscard]] Safetensors parse_safetensors(std::span<const std::byte> bytes,
                                            const std::string& name);

/// IEEE 754 half precision to float, exactly, with subnormals, infinities and NaN.
[[nodiscard]] float float_of_half(std::uint16_t half);

}  // namespace stillmap::mapping

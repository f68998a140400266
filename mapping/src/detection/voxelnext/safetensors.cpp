#include "detection/voxelnext/safetensors.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/json_fields.hpp>

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

namespace stillmap::mapping {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie");

using maps::InputError;
using maps::JsonField;

constexpr std::size_t kLengthBytes = 8;
/// More than any shape of a network; a bound keeps a hostile one from being long.
constexpr std::size_t kMaxDimensions = 8;

std::size_t bytes_per_number(TensorType type) { return type == TensorType::kF32 ? 4 : 2; }

/// One entry of the header.
class Entry {
 public:
  explicit Entry(const JsonField& field) : field_(field) {
    field.exactly({"dtype", "shape", "data_offsets"});
  }

  [[nodiscard]] TensorType type() const {
    return field_.at("dtype").one_of<TensorType>(
        {{"F32", TensorType::kF32}, {"F16", TensorType::kF16}});
  }

  [[nodiscard]] std::vector<std::size_t> shape() const {
    std::vector<std::size_t> shape;
    for (const JsonField& size : field_.at("shape").elements(0, kMaxDimensions))
      shape.push_back(size.count());
    return shape;
  }

  /// First byte and the one past the last, from the end of the header on, within `size`.
  [[nodiscard]] std::pair<std::size_t, std::size_t> range(std::size_t size) const {
    const JsonField offsets = field_.at("data_offsets");
    const std::vector<JsonField> both = offsets.elements(2, 2);
    const std::size_t begin = both[0].count(), end = both[1].count();
    if (end < begin) both[1].refuse("at least " + std::to_string(begin) + ", where it begins");
    if (end > size)
      both[1].refuse("at most " + std::to_string(size) + ", the bytes after the header");
    return {begin, end};
  }

  /// Checks that `bytes` is what shape and type need, without overflow.
  void check_size(const std::vector<std::size_t>& shape, TensorType type, std::size_t bytes) const {
    std::size_t needed = bytes_per_number(type);
    for (const std::size_t size : shape)
      if (__builtin_mul_overflow(needed, size, &needed))
        field_.at("shape").refuse("numbers that can be addressed");
    if (needed != bytes)
      field_.at("shape").refuse("numbers that fill the " + std::to_string(bytes) +
                                " bytes of data_offsets, and not " + std::to_string(needed));
  }

 private:
  JsonField field_;
};

/// The header's text; leaves the tensors' bytes in `bytes`.
std::string_view split_header(std::span<const std::byte>& bytes, const std::string& name) {
  if (bytes.size() < kLengthBytes) {
    throw InputError(name, std::to_string(bytes.size()) + " bytes",
                     "at least 8, the header's length");
  }
  std::uint64_t length = 0;
  std::memcpy(&length, bytes.data(), kLengthBytes);
  bytes = bytes.subspan(kLengthBytes);
  if (length > kMaxHeaderBytes) {
    throw InputError(name, "a header of " + std::to_string(length) + " bytes",
                     "safetensors with one of at most " + std::to_string(kMaxHeaderBytes));
  }
  if (length > bytes.size()) {
    throw InputError(name, std::to_string(bytes.size()) + " bytes after the header's length",
                     "a header of " + std::to_string(length) + " bytes");
  }
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), length);
  bytes = bytes.subspan(length);
  if (!text.starts_with('{')) throw InputError(name, "no JSON object", "a safetensors header");
  return text;
}

void read_metadata(const JsonField& field, Safetensors& result) {
  field.each_member([&](const std::string& key, const JsonField& value) {
    result.metadata.emplace(key, value.text());
  });
}

/// The tensors lie one behind the other and end with the file.
void check_cover(const Safetensors& file, std::span<const std::byte> bytes,
                 const std::string& name) {
  std::vector<std::pair<std::size_t, std::size_t>> ranges;
  ranges.reserve(file.tensors.size());
  for (const auto& [tensor, view] : file.tensors) {
    const auto begin = static_cast<std::size_t>(view.bytes.data() - bytes.data());
    ranges.emplace_back(begin, begin + view.bytes.size());
  }
  std::ranges::sort(ranges);
  std::size_t covered = 0;
  for (const auto& [begin, end] : ranges) {
    if (begin != covered) {
      throw InputError(name,
                       std::string(begin < covered ? "tensors that overlap" : "a gap") +
                           " at byte " + std::to_string(begin) + " after the header",
                       "a tensor that begins at byte " + std::to_string(covered));
    }
    covered = end;
  }
  if (covered != bytes.size()) {
    throw InputError(name, std::to_string(bytes.size()) + " bytes after the header",
                     std::to_string(covered) + ", where the last tensor ends");
  }
}

}  // namespace

std::size_t TensorView::count() const { return bytes.size() / bytes_per_number(type); }

std::vector<float> TensorView::floats() const {
  std::vector<float> numbers(count());
  if (numbers.empty()) return numbers;  // memcpy takes no null pointer
  if (type == TensorType::kF32) {
    std::memcpy(numbers.data(), bytes.data(), bytes.size());
    return numbers;
  }
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    std::uint16_t half = 0;
    std::memcpy(&half, bytes.data() + 2 * i, 2);
    numbers[i] = float_of_half(half);
  }
  return numbers;
}

Safetensors parse_safetensors(std::span<const std::byte> bytes, const std::string& name) {
  const nlohmann::json header =
      maps::parse_json(split_header(bytes, name), name + " in its header");
  Safetensors result;
  for (const auto& [tensor, value] : header.items()) {
    if (tensor == "__metadata__") {
      read_metadata(JsonField(value, name, tensor), result);
      continue;
    }
    const Entry entry(JsonField(value, name, "tensor " + maps::described(tensor)));
    const auto [begin, end] = entry.range(bytes.size());
    TensorView view{entry.type(), entry.shape(), bytes.subspan(begin, end - begin)};
    entry.check_size(view.shape, view.type, view.bytes.size());
    result.tensors.emplace(tensor, std::move(view));
  }
  check_cover(result, bytes, name);
  return result;
}

float float_of_half(std::uint16_t half) {
  const std::uint32_t sign = (half & 0x8000U) << 16U;
  const std::uint32_t exponent = (half >> 10U) & 0x1fU;
  const std::uint32_t fraction = half & 0x3ffU;
  if (exponent == 0) {  // zero or subnormal: fraction * 2^-24, exact in float
    const float magnitude = static_cast<float>(fraction) * 0x1p-24F;
    return sign == 0 ? magnitude : -magnitude;
  }
  const std::uint32_t widened = exponent == 0x1fU ? 0xffU : exponent + (127U - 15U);
  return std::bit_cast<float>(sign | (widened << 23U) | (fraction << 13U));
}

}  // namespace stillmap::mapping

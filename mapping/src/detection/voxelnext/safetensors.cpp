#include "detection/voxelnext/safetensors.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <bit>
#include <cstring>
#include <optional>
#include <utility>

#include "detection/strict_json.hpp"

namespace stillmap::mapping {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie");

using maps::InputError;

constexpr std::size_t kLengthBytes = 8;
/// More than any shape of a network; a bound keeps a hostile one from being long.
constexpr std::size_t kMaxDimensions = 8;

std::size_t bytes_per_number(TensorType type) { return type == TensorType::kF32 ? 4 : 2; }

/// Reads one entry of the header, with messages that name file and tensor.
class Entry {
 public:
  Entry(const std::string& file, const std::string& tensor, const nlohmann::json& value)
      : name_(file + " at tensor " + in_quotes(tensor)), value_(value) {
    constexpr auto kExpected = "an object with dtype, shape and data_offsets";
    if (!value.is_object()) throw InputError(name_, described(value), kExpected);
    for (auto member = value.begin(); member != value.end(); ++member) {
      if (member.key() == "dtype" || member.key() == "shape" || member.key() == "data_offsets") {
        continue;
      }
      throw InputError(name_, "key " + in_quotes(member.key()), kExpected);
    }
  }

  [[nodiscard]] TensorType type() const {
    const nlohmann::json& found = at("dtype");
    if (found == "F32") return TensorType::kF32;
    if (found == "F16") return TensorType::kF16;
    throw InputError(name_, "dtype " + described(found), "F32 or F16");
  }

  [[nodiscard]] std::vector<std::size_t> shape() const {
    const nlohmann::json& found = at("shape");
    if (!found.is_array() || found.size() > kMaxDimensions) {
      throw InputError(name_, "shape " + described(found),
                       "at most " + std::to_string(kMaxDimensions) + " whole numbers");
    }
    std::vector<std::size_t> shape;
    for (const nlohmann::json& size : found) shape.push_back(whole("shape", size));
    return shape;
  }

  /// First byte and the one past the last, from the end of the header on, within `size`.
  [[nodiscard]] std::pair<std::size_t, std::size_t> range(std::size_t size) const {
    const nlohmann::json& found = at("data_offsets");
    if (!found.is_array() || found.size() != 2) {
      throw InputError(name_, "data_offsets " + described(found), "two whole numbers");
    }
    const std::size_t begin = whole("data_offsets", found[0]);
    const std::size_t end = whole("data_offsets", found[1]);
    if (begin > end || end > size) {
      throw InputError(name_, "bytes " + std::to_string(begin) + " to " + std::to_string(end),
                       "a range within the " + std::to_string(size) + " bytes after the header");
    }
    return {begin, end};
  }

  /// Checks that `bytes` is what shape and type need, without overflow.
  void check_size(const std::vector<std::size_t>& shape, TensorType type, std::size_t bytes) const {
    std::optional<std::size_t> needed = bytes_per_number(type);
    for (const std::size_t size : shape) {
      std::size_t product = 0;
      if (__builtin_mul_overflow(*needed, size, &product)) {
        throw InputError(name_, "a shape of more numbers than can be addressed",
                         std::to_string(bytes) + " bytes of them");
      }
      needed = product;
    }
    if (*needed != bytes) {
      throw InputError(name_, std::to_string(bytes) + " bytes",
                       std::to_string(*needed) + ", by its shape and dtype");
    }
  }

 private:
  [[nodiscard]] const nlohmann::json& at(const char* key) const {
    const auto found = value_.find(key);
    if (found == value_.end()) {
      throw InputError(name_, std::string("no ") + key, "dtype, shape and data_offsets");
    }
    return *found;
  }
  [[nodiscard]] std::size_t whole(const char* key, const nlohmann::json& value) const {
    if (!value.is_number_unsigned()) {
      throw InputError(name_, std::string(key) + " with " + described(value),
                       "whole numbers >= 0 below 2^64");
    }
    return value.get<std::size_t>();
  }

  std::string name_;
  const nlohmann::json& value_;
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

void read_metadata(const nlohmann::json& value, const std::string& name, Safetensors& result) {
  const std::string at = name + " at __metadata__";
  if (!value.is_object()) throw InputError(at, described(value), "an object of texts");
  for (auto member = value.begin(); member != value.end(); ++member) {
    if (!member->is_string()) {
      throw InputError(at, in_quotes(member.key()) + " with " + described(*member), "a text");
    }
    result.metadata.emplace(member.key(), member->get<std::string>());
  }
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
      parse_strict_json(split_header(bytes, name), name + " in its header");
  Safetensors result;
  for (auto member = header.begin(); member != header.end(); ++member) {
    if (member.key() == "__metadata__") {
      read_metadata(*member, name, result);
      continue;
    }
    const Entry entry(name, member.key(), *member);
    const auto [begin, end] = entry.range(bytes.size());
    TensorView view{entry.type(), entry.shape(), bytes.subspan(begin, end - begin)};
    entry.check_size(view.shape, view.type, view.bytes.size());
    result.tensors.emplace(member.key(), std::move(view));
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

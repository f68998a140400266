#pragma once

#include <cstddef>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

namespace stillmap::mapping {

/// A number as it lies in memory: for records that a machine alike reads again.
template <typename Number>
  requires std::is_arithmetic_v<Number> || std::is_enum_v<Number>
void put_number(std::string& bytes, Number value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Takes a record apart; whatever the bytes say, never beyond their end.
class ByteReader {
 public:
  /// @param what  the record is, for messages.
  ByteReader(std::string_view bytes, std::string what) : bytes_(bytes), what_(std::move(what)) {}

  /// @throws std::invalid_argument where the record ends too early, as all below.
  [[nodiscard]] std::string_view take(std::size_t size) {
    if (size > bytes_.size()) refuse("ends too early");
    const std::string_view taken = bytes_.substr(0, size);
    bytes_.remove_prefix(size);
    return taken;
  }
  template <typename Number>
  [[nodiscard]] Number number() {
    Number value{};
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  /// How many elements follow, of so many bytes or more each.
  [[nodiscard]] std::size_t count(std::size_t least_bytes) {
    const auto count = number<std::size_t>();
    if (count > bytes_.size() / least_bytes) refuse("more elements than bytes");
    return count;
  }
  void end() const {
    if (!bytes_.empty()) refuse("bytes left over");
  }
  [[noreturn]] void refuse(const std::string& why) const {
    throw std::invalid_argument(what_ + ": " + why);
  }

 private:
  std::string_view bytes_;
  std::string what_;
};

}  // namespace stillmap::mapping

#include "bags/message_reader.hpp"

#include <fmt/format.h>

#include <utility>

namespace stillmap::maps {

MessageReader::MessageReader(std::span<const std::byte> message, Serialization serialization,
                             std::string name)
    : body_(message), ros1_(serialization == Serialization::kRos1), name_(std::move(name)) {
  if (ros1_) return;
  if (serialization != Serialization::kCdr)
    throw InputError(name_, "a message that is not CDR", "CDR, or ROS 1 where it says ros1");
  if (message.size() < 4)
    throw InputError(name_, fmt::format("{} bytes", message.size()), "4 of CDR's encapsulation");
  const auto kind = static_cast<unsigned>(message[0]) << 8U | static_cast<unsigned>(message[1]);
  constexpr unsigned kZstd = 0x28b5;
  if (kind == kZstd)
    throw InputError(name_, "a message that is packed with zstd by itself",
                     "MCAP with packed chunks instead (`ros2 bag convert`)");
  if (kind > 1)
    throw InputError(name_, fmt::format("CDR of encapsulation {:04x}", kind),
                     "0000 (big endian) or 0001 (little endian)");
  big_endian_ = kind == 0;
  body_ = message.subspan(4);
}

void MessageReader::align(std::size_t size) {
  if (!ros1_) position_ = (position_ + size - 1) / size * size;
}

std::span<const std::byte> MessageReader::take(std::size_t size) {
  if (position_ > body_.size() || size > body_.size() - position_)
    throw InputError(name_, fmt::format("{} bytes", body_.size()),
                     fmt::format("{} more at {}", size, position_));
  const std::span<const std::byte> taken = body_.subspan(position_, size);
  position_ += size;
  return taken;
}

std::string MessageReader::text(std::size_t most) {
  const auto length = number<std::uint32_t>();
  if (length > most + 1)
    throw InputError(name_, fmt::format("a text of {} bytes", length),
                     fmt::format("at most {}", most));
  const std::span<const std::byte> letters = take(length);
  std::string text(reinterpret_cast<const char*>(letters.data()), letters.size());
  if (!ros1_ && !text.empty()) {
    if (text.back() != '\0') throw InputError(name_, "a text without its NUL", "one");
    text.pop_back();
  }
  return text;
}

std::span<const std::byte> MessageReader::bytes() { return take(number<std::uint32_t>()); }

std::size_t MessageReader::count(std::size_t least_bytes_each) {
  const auto count = number<std::uint32_t>();
  const std::size_t left = position_ < body_.size() ? body_.size() - position_ : 0;
  if (count > left / least_bytes_each)
    throw InputError(name_, fmt::format("a sequence of {} in {} bytes", count, left),
                     fmt::format("at least {} bytes each", least_bytes_each));
  return count;
}

}  // namespace stillmap::maps

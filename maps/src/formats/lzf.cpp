#include "formats/lzf.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cstring>
#include <utility>

namespace stillmap::maps {
namespace {

constexpr std::size_t kWindow = 8192;
constexpr std::size_t kPiece = 65536;
/// That one instruction makes.
constexpr std::size_t kMostAtOnce = 264;

}  // namespace

LzfReader::LzfReader(std::span<const std::byte> packed, std::size_t expected_size, std::string name)
    : packed_(packed),
      expected_size_(expected_size),
      name_(std::move(name)),
      buffer_(kWindow + kPiece) {}

void LzfReader::read(std::span<std::byte> out) {
  while (!out.empty()) {
    if (taken_ == end_) fill();
    const std::size_t count = std::min(out.size(), end_ - taken_);
    std::memcpy(out.data(), &buffer_[taken_], count);
    taken_ += count;
    out = out.subspan(count);
  }
}

void LzfReader::skip(std::size_t bytes) {
  while (bytes > 0) {
    if (taken_ == end_) fill();
    const std::size_t count = std::min(bytes, end_ - taken_);
    taken_ += count;
    bytes -= count;
  }
}

void LzfReader::finish() {
  skip(expected_size_ - total_ + end_ - taken_);
  if (in_ < packed_.size()) fail("compressed points that go on");
}

void LzfReader::fail(const std::string& found) const {
  throw InputError(name_, found,
                   "LZF that unpacks to " + std::to_string(expected_size_) + " bytes");
}

void LzfReader::fill() {
  if (end_ > kWindow) {
    std::memmove(buffer_.data(), &buffer_[end_ - kWindow], kWindow);
    taken_ = end_ = kWindow;
  }
  if (in_ == packed_.size()) fail(std::to_string(total_) + " bytes");
  while (in_ < packed_.size() && end_ + kMostAtOnce <= buffer_.size()) unpack_one();
}

std::size_t LzfReader::next_byte() {
  if (in_ >= packed_.size()) fail("compressed points that break off");
  return std::to_integer<std::size_t>(packed_[in_++]);
}

void LzfReader::unpack_one() {
  const std::size_t control = next_byte();
  std::size_t count = control + 1;
  std::size_t distance = 0;
  if (control >= 32) {
    count = control >> 5U;
    if (count == 7) count += next_byte();
    count += 2;
    distance = ((control & 31U) << 8U) + next_byte() + 1;
    if (distance > total_) fail("a reference before the first byte");
  } else if (count > packed_.size() - in_) {
    fail("compressed points that break off");
  }
  if (count > expected_size_ - total_) fail("compressed points that go on");
  if (distance > 0) {
    // Byte by byte: source and target overlap when a reference repeats what it writes.
    for (std::size_t i = 0; i < count; ++i) buffer_[end_ + i] = buffer_[end_ + i - distance];
  } else {
    std::memcpy(&buffer_[end_], &packed_[in_], count);
    in_ += count;
  }
  end_ += count;
  total_ += count;
}

}  // namespace stillmap::maps

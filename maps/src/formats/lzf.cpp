#include "formats/lzf.hpp"

#include <stillmap/maps/error.hpp>

#include <cstring>
#include <vector>

namespace stillmap::maps {
namespace {

constexpr std::size_t kWindow = 8192;
constexpr std::size_t kPiece = 65536;

/// Output with as much of its past as references can reach.
class Output {
 public:
  explicit Output(const std::function<void(std::span<const std::byte>)>& consume)
      : buffer_(kWindow + kPiece), consume_(consume) {}

  [[nodiscard]] std::size_t total() const { return total_; }

  void literals(const std::byte* bytes, std::size_t count) {
    make_room(count);
    std::memcpy(&buffer_[end_], bytes, count);
    advance(count);
  }
  /// @pre 1 <= distance <= min(total(), kWindow)
  void reference(std::size_t distance, std::size_t count) {
    make_room(count);
    // Byte by byte: source and target overlap when a reference repeats what it writes.
    for (std::size_t i = 0; i < count; ++i) buffer_[end_ + i] = buffer_[end_ + i - distance];
    advance(count);
  }
  void flush() {
    consume_({&buffer_[flushed_], end_ - flushed_});
    flushed_ = end_;
  }

 private:
  void make_room(std::size_t count) {
    if (end_ + count < buffer_.size()) return;
    flush();
    std::memmove(buffer_.data(), &buffer_[end_ - kWindow], kWindow);
    end_ = flushed_ = kWindow;
  }
  void advance(std::size_t count) {
    end_ += count;
    total_ += count;
  }

  std::vector<std::byte> buffer_;
  std::size_t flushed_ = 0;
  std::size_t end_ = 0;
  std::size_t total_ = 0;
  const std::function<void(std::span<const std::byte>)>& consume_;
};

}  // namespace

void unpack_lzf(std::span<const std::byte> compressed, std::size_t expected_size,
                const std::string& name,
                const std::function<void(std::span<const std::byte>)>& consume) {
  const auto fail = [&](const std::string& found) {
    throw InputError(name, found,
                     "LZF that unpacks to " + std::to_string(expected_size) + " bytes");
  };
  Output output(consume);
  std::size_t in = 0;
  const auto next = [&] {
    if (in >= compressed.size()) fail("compressed points that break off");
    return std::to_integer<std::size_t>(compressed[in++]);
  };
  while (in < compressed.size()) {
    const std::size_t control = next();
    std::size_t count = control + 1;
    std::size_t distance = 0;
    if (control >= 32) {
      count = control >> 5U;
      if (count == 7) count += next();
      count += 2;
      distance = ((control & 31U) << 8U) + next() + 1;
      if (distance > output.total()) fail("a reference before the first byte");
    } else if (count > compressed.size() - in) {
      fail("compressed points that break off");
    }
    if (count > expected_size - output.total()) fail("compressed points that go on");
    if (distance > 0) {
      output.reference(distance, count);
    } else {
      output.literals(&compressed[in], count);
      in += count;
    }
  }
  if (output.total() != expected_size) fail(std::to_string(output.total()) + " bytes");
  output.flush();
}

}  // namespace stillmap::maps

#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace stillmap::maps {

/// Most bytes that LZF can make of `compressed` ones: 264 out of 3.
[[nodiscard]] constexpr std::size_t max_lzf_output(std::size_t compressed) {
  return (compressed / 3 + 1) * 264;
}

/// Unpacks LZF (as in liblzf, PCL's `binary_compressed`) as far as it is asked to; memory stays at
/// 72 KiB whatever the size of the output, because references reach back 8 KiB at most.
///
/// Its functions throw InputError naming `name` when the stream is broken or gives another size.
class LzfReader {
 public:
  /// @param packed         outlives this. @param expected_size  bytes that must come out.
  LzfReader(std::span<const std::byte> packed, std::size_t expected_size, std::string name);

  /// Fills `out` with what comes next.
  void read(std::span<std::byte> out);
  void skip(std::size_t bytes);
  /// Looks through what is left, so that the whole stream has been checked.
  void finish();

 private:
  [[noreturn]] void fail(const std::string& found) const;
  /// Unpacks more; for good when there is some.
  void fill();
  void unpack_one();
  [[nodiscard]] std::size_t next_byte();

  std::span<const std::byte> packed_;
  std::size_t expected_size_;
  std::string name_;
  std::size_t in_ = 0;
  /// As much of the past as references can reach, then what was unpacked, of it up to `taken_`
  /// handed on.
  std::vector<std::byte> buffer_;
  std::size_t taken_ = 0;
  std::size_t end_ = 0;
  std::size_t total_ = 0;
};

}  // namespace stillmap::maps

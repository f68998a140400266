#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>

namespace stillmap::maps {

/// Most bytes that LZF can make of `compressed` ones: 264 out of 3.
[[nodiscard]] constexpr std::size_t max_lzf_output(std::size_t compressed) {
  return (compressed / 3 + 1) * 264;
}

/// Unpacks LZF (as in liblzf, PCL's `binary_compressed`) piece by piece; memory stays at some 80
/// KiB whatever the size of the output, because references reach back 8 KiB at most.
/// @param expected_size  bytes that must come out.
/// @param consume        takes the pieces in order.
/// @throws InputError naming `name` when the stream is broken or gives another size.
void unpack_lzf(std::span<const std::byte> compressed, std::size_t expected_size,
                const std::string& name,
                const std::function<void(std::span<const std::byte>)>& consume);

}  // namespace stillmap::maps

#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>

/// Bytes of scan files, written out by hand so that tests do not depend on a writer of ours.
namespace stillmap::test {

template <typename Number>
void append(std::string& bytes, Number number) {
  char raw[sizeof(Number)];
  std::memcpy(raw, &number, sizeof(Number));
  bytes.append(raw, sizeof(Number));
}

template <typename Number>
void append_big_endian(std::string& bytes, Number number) {
  char raw[sizeof(Number)];
  std::memcpy(raw, &number, sizeof(Number));
  for (std::size_t i = sizeof(Number); i-- > 0;) bytes += raw[i];
}

inline std::span<const std::byte> as_bytes(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

/// Point of a KITTI scan.
inline std::string xyzi(float x, float y, float z, float intensity) {
  std::string bytes;
  for (const float value : {x, y, z, intensity}) append(bytes, value);
  return bytes;
}

/// LZF by the simplest rule: a reference wherever the last 8 KiB hold the next 3 bytes or more,
/// else a literal.
inline std::string lzf(std::string_view in) {
  std::string out;
  for (std::size_t i = 0; i < in.size();) {
    std::size_t best = 0;
    std::size_t distance = 0;
    for (std::size_t back = 1; back <= i && back <= 8192; ++back) {
      std::size_t length = 0;
      while (length < 264 && i + length < in.size() && in[i + length] == in[i + length - back]) {
        ++length;
      }
      if (length > best) {
        best = length;
        distance = back - 1;
      }
    }
    if (best < 3) {
      out += '\0';  // a run of one literal
      out += in[i++];
      continue;
    }
    const std::size_t code = best - 2;
    out += static_cast<char>((code < 7 ? code : 7) << 5U | distance >> 8U);
    if (code >= 7) out += static_cast<char>(code - 7);
    out += static_cast<char>(distance & 255U);
    i += best;
  }
  return out;
}

inline std::string pcd_compressed_body(std::string_view columns) {
  const std::string packed = lzf(columns);
  std::string body;
  append(body, static_cast<std::uint32_t>(packed.size()));
  append(body, static_cast<std::uint32_t>(columns.size()));
  return body + packed;
}

}  // namespace stillmap::test

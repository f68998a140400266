#pragma once

#include <cstddef>
#include <span>
#include <string_view>

namespace stillmap::mapping {

/// The weights file that was compiled in (weights/default.safetensors); empty when there was none.
[[nodiscard]] std::span<const std::byte> embedded_weights();
/// Of that file, in hexadecimal; empty when there was none.
[[nodiscard]] std::string_view embedded_weights_sha256();

}  // namespace stillmap::mapping

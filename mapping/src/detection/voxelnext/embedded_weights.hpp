#pragma once

#include <cstddef>
#include <span>

namespace stillmap::mapping {

/// The weights file that was compiled in (weights/default.safetensors); empty when there was none.
[[nodiscard]] std::span<const std::byte> embedded_weights();

}  // namespace stillmap::mapping

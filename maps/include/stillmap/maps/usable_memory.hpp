#pragma once

#include <cstdint>

namespace stillmap::maps {

/// The memory that this process may have: the machine's, or the control group's where that is less
/// [bytes].
[[nodiscard]] std::uint64_t usable_memory_bytes();

}  // namespace stillmap::maps

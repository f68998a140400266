#pragma once

#include <cstdint>

namespace stillmap::server {

/// A part of the memory that this process may have: of the machine's, or of the control group's
/// where that is less. Bounds what of an upload is held at once.
/// @param parts  1/parts of it. @return bytes.
[[nodiscard]] std::uint64_t share_of_memory(std::uint64_t parts);

}  // namespace stillmap::server

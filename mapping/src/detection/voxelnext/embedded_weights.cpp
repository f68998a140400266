#include "detection/voxelnext/embedded_weights.hpp"

#ifdef STILLMAP_VOXELNEXT_WEIGHTS

// A compiler takes minutes over an array of some million numbers; the assembler copies the file.
asm(".pushsection .rodata\n"
    ".balign 64\n"
    ".globl stillmap_voxelnext_weights_begin\n"
    "stillmap_voxelnext_weights_begin:\n"
    ".incbin \"" STILLMAP_VOXELNEXT_WEIGHTS
    "\"\n"
    ".globl stillmap_voxelnext_weights_end\n"
    "stillmap_voxelnext_weights_end:\n"
    ".byte 0\n"
    ".popsection\n");

// NOLINTBEGIN(readability-identifier-naming): names of the assembler's symbols
extern "C" {
extern const std::byte stillmap_voxelnext_weights_begin[];
extern const std::byte stillmap_voxelnext_weights_end[];
}
// NOLINTEND(readability-identifier-naming)

namespace stillmap::mapping {

std::span<const std::byte> embedded_weights() {
  return {stillmap_voxelnext_weights_begin, stillmap_voxelnext_weights_end};
}

std::string_view embedded_weights_sha256() { return STILLMAP_VOXELNEXT_WEIGHTS_SHA256; }

}  // namespace stillmap::mapping

#else

namespace stillmap::mapping {

std::span<const std::byte> embedded_weights() { return {}; }

std::string_view embedded_weights_sha256() { return {}; }

}  // namespace stillmap::mapping

#endif

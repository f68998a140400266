// libFuzzer on the reader of VoxelNeXt weights: any bytes are read or refused with
// maps::InputError.
#include <stillmap/maps/error.hpp>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "detection/voxelnext/config_text.hpp"
#include "detection/voxelnext/weights.hpp"

namespace {

template <typename Read>
void read_or_refuse(Read&& read) {
  try {
    read();
  } catch (const stillmap::maps::InputError&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap::mapping;
  const std::span<const std::uint8_t> input(data, size);
  // As a whole file, where the length in front must be guessed; as a header behind the right
  // length; and as a config alone.
  read_or_refuse([&] { (void)read_voxelnext_weights(std::as_bytes(input), "fuzz"); });
  const std::string text(reinterpret_cast<const char*>(data), size);
  std::vector<std::byte> file(8 + size + 64);
  const std::uint64_t length = size;
  std::memcpy(file.data(), &length, 8);
  std::memcpy(file.data() + 8, text.data(), size);
  read_or_refuse([&] { (void)read_voxelnext_weights(file, "fuzz"); });
  read_or_refuse([&] { (void)parse_voxelnext_config(text, "fuzz"); });
  return 0;
}

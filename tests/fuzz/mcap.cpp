// MCAP files, also packed as a whole, as drives: `maps::Drive::open`.
#include "bag_rules.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  const std::string_view text = fuzz::text_of(data, size);
  const bool packed = text.starts_with("\x28\xb5\x2f\xfd");
  fuzz::drive_through(fuzz::put(packed ? "bag.mcap.zstd" : "bag.mcap", text));
  return 0;
}

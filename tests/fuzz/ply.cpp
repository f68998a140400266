// PLY files and bodies: `maps::decode_scan`.
#include "scan_rules.hpp"

#include <stillmap/maps/error.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  constexpr std::size_t kMostPoints = 100'000;
  const auto scan = fuzz::taken<maps::InputError>([&] {
    return maps::decode_scan(fuzz::bytes_of(fuzz::text_of(data, size)), maps::ScanFormat::kPly,
                             "fuzz", kMostPoints);
  });
  if (scan) fuzz::require_decoded(*scan, kMostPoints);
  return 0;
}

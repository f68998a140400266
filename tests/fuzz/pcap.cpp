// Captures of a Velodyne's packets, pcap and pcapng, as drives: `maps::Drive::open`.
#include "bag_rules.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  fuzz::drive_through(fuzz::put("run.pcap", fuzz::text_of(data, size)));
  return 0;
}

// Bags of ROS 1 as drives: `maps::Drive::open`.
#include "bag_rules.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  fuzz::drive_through(fuzz::put("bag.bag", fuzz::text_of(data, size)));
  return 0;
}

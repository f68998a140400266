// Raw bodies of a pose request. The first byte says how they are announced, the rest is the scan.
#include "pose_rules.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  if (size == 0) return 0;
  const std::string_view body = fuzz::text_of(data + 1, size - 1);
  switch (data[0] % 5) {
    case 0:
      fuzz::read_and_require("application/octet-stream", body);
      break;
    case 1:
      fuzz::read_and_require("application/octet-stream", body, {{"layout", "xyz"}});
      break;
    case 3:
      fuzz::read_and_require("application/octet-stream", body, {{"layout", "xyzit"}});
      break;
    case 4:
      fuzz::read_and_require("application/vnd.stillmap.scan", body);
      break;
    default:
      fuzz::read_and_require("application/vnd.pcd", body);
  }
  return 0;
}

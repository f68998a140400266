// JSON of a pose request, with the scan inside and beside it.
#include "bodies/pose_request_json.hpp"
#include "pose_rules.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  const std::string_view text = fuzz::text_of(data, size);
  fuzz::read_and_require("application/json", text);
  for (const auto scan : {server::JsonScan::kRawBeside, server::JsonScan::kPcdBeside}) {
    const auto read = fuzz::taken<server::ApiError>([&] {
      return server::read_pose_request_json(text, scan, server::ScanPurpose::kQuery,
                                            fuzz::small_options());
    });
    if (read) fuzz::require_bounds(read->parameters);
  }
  return 0;
}

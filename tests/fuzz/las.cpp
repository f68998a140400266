// LAS files: `maps::stream_las`, which hands points on, what it says of their coordinates, and
// `maps::check_cloud_header`.
#include "cloud_rules.hpp"

#include <stillmap/maps/error.hpp>

#include "formats/las.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  const std::string_view text = fuzz::text_of(data, size);
  std::uint64_t points = 0;
  const auto summary = fuzz::taken<maps::InputError>([&] {
    return maps::stream_las(fuzz::bytes_of(text), "fuzz",
                            [&](std::span<const maps::CloudPoint> some) {
                              points += some.size();
                              for (const maps::CloudPoint& point : some)
                                fuzz::require(point.position.allFinite(), "points are finite");
                            });
  });
  fuzz::require_header(text, "las", summary.has_value());
  if (!summary) return 0;
  fuzz::require(points + summary->withheld == summary->points_in_file,
                "every point is kept or counted");
  fuzz::require(points * 20 <= size, "no more points than bytes");
  fuzz::require(!summary->utm || (summary->utm->number >= 1 && summary->utm->number <= 60),
                "zones are those there are");
  return 0;
}

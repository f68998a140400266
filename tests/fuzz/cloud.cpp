// PCD and PLY files as maps: `maps::stream_pcd` and `maps::stream_ply`, which hand points on, and
// `maps::check_cloud_header`, by which a server refuses what they could not read.
#include "cloud_rules.hpp"

#include <stillmap/maps/error.hpp>

#include <cmath>
#include <string_view>

#include "formats/pcd.hpp"
#include "formats/ply.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  const std::string_view text = fuzz::text_of(data, size);
  std::uint64_t points = 0;
  const auto take = [&](std::span<const maps::CloudPoint> some) {
    points += some.size();
    for (const maps::CloudPoint& point : some) {
      fuzz::require(point.position.allFinite(), "points are finite");
      fuzz::require(std::isfinite(point.intensity), "intensities are finite");
    }
  };
  const bool is_ply = text.starts_with("ply");
  const auto summary = fuzz::taken<maps::InputError>([&] {
    return is_ply ? maps::stream_ply(fuzz::bytes_of(text), "fuzz", take)
                  : maps::stream_pcd(fuzz::bytes_of(text), "fuzz", take);
  });
  fuzz::require_header(text, is_ply ? "ply" : "pcd", summary.has_value());
  if (summary)
    fuzz::require(points + summary->non_finite == summary->points_in_file,
                  "every point is handed on or counted");
  return 0;
}

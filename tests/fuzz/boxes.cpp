// Boxes beside a drive: JSON or KITTI tracking labels (with a calibration beside them), and
// objects.json of a map.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/error.hpp>

#include <cmath>

#include "boxes/kitti_labels.hpp"
#include "package/objects_json.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  constexpr std::size_t kScans = 100;
  static const std::filesystem::path calibration =
      fuzz::put("calib.txt",
                "R_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n"
                "P2: 721 0 609 44 0 721 172 0.2 0 0 1 0.003\n");
  const std::string_view text = fuzz::text_of(data, size);
  const std::filesystem::path file = fuzz::put("boxes", text);
  if (const auto read =
          fuzz::taken<maps::InputError>([&] { return maps::read_boxes(file, kScans); })) {
    for (const auto& [scan, boxes] : read->by_scan) {
      fuzz::require(scan < kScans, "scans of the drive");
      for (const maps::Box& box : boxes) {
        fuzz::require(box.size_m.minCoeff() > 0.0 && box.size_m.maxCoeff() <= maps::kMaxBoxSizeM,
                      "a size in its bounds");
        // The camera stands beside the sensor.
        fuzz::require(box.centre.cwiseAbs().maxCoeff() <= 2.0 * maps::kMaxBoxDistanceM,
                      "a centre in its bounds");
        fuzz::require(std::isfinite(box.yaw_rad) && box.score >= 0.0 && box.score <= 1.0,
                      "a yaw and a score");
      }
    }
  }
  const auto objects =
      fuzz::taken<maps::InputError>([&] { return maps::parse_objects(text, "fuzz"); });
  if (!objects) return 0;
  const std::string canonical = maps::objects_text(*objects);
  fuzz::require(maps::objects_text(maps::parse_objects(canonical, "again")) == canonical,
                "objects read back as themselves");
  return 0;
}

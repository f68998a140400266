// Text files of a KITTI drive: calibrations, and oxts packets with their stamps. What stands before
// the byte 0x1e is the stamps, the rest a calibration and an oxts packet.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>

#include "boxes/kitti_calibration.hpp"
#include "drives/calibration.hpp"
#include "drives/oxts.hpp"

namespace {

using namespace stillmap;

template <typename Read>
void read_finite(Read&& read) {
  const auto T = fuzz::taken<maps::InputError>(read);
  fuzz::require(!T || T->matrix().allFinite(), "a transform is finite");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const bool made =
      std::filesystem::create_directories(fuzz::folder().path() / "oxts" / "data");
  static_cast<void>(made);
  std::string_view text = fuzz::text_of(data, size);
  fuzz::put("oxts/timestamps.txt", fuzz::take_until(text, 0x1e));
  fuzz::put("oxts/data/0000000000.txt", text);
  fuzz::put("oxts/data/0000000001.txt", text);
  const std::filesystem::path file = fuzz::put("calib.txt", text);
  read_finite([&] { return maps::read_T_velo_imu(file); });
  read_finite([&] { return maps::read_T_cam_velo(file); });
  read_finite([&] { return maps::read_T_rect_lidar(fuzz::folder().path() / "label.txt"); });
  if (const auto view = fuzz::taken<maps::InputError>(
          [&] { return maps::read_camera_view(fuzz::folder().path() / "label.txt"); })) {
    fuzz::require(view->P_image_lidar.allFinite() && view->size_px.minCoeff() > 0.0,
                  "a camera is finite and has an image");
  }
  const auto path = fuzz::taken<maps::InputError>(
      [&] { return maps::read_oxts(fuzz::folder().path() / "oxts"); });
  if (!path) return 0;
  for (std::size_t i = 0; i < path->T_map_imu.size(); ++i) {
    fuzz::require(path->T_map_imu[i].T_map_lidar.matrix().allFinite(), "oxts poses are finite");
    fuzz::require(i == 0 || path->T_map_imu[i].stamp_ns > path->T_map_imu[i - 1].stamp_ns,
                  "oxts stamps increase");
  }
  return 0;
}

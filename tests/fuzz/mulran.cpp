// Tables of a MulRan sequence: what stands before the byte 0x1e is the list of its scans, the rest
// their poses. The scans themselves are those of KITTI.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>

#include "drives/mulran.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  static const bool made = [] {
    std::filesystem::create_directories(fuzz::folder().path() / "Ouster");
    for (const char* name : {"1561000444390857630", "1561000444490857630", "1561000444590857630"})
      fuzz::put(std::string("Ouster/") + name + ".bin", "");
    return true;
  }();
  static_cast<void>(made);
  std::string_view text = fuzz::text_of(data, size);
  fuzz::put("ouster_front_stamp.csv", fuzz::take_until(text, 0x1e));
  fuzz::put("global_pose.csv", text);
  const auto contents =
      fuzz::taken<maps::InputError>([&] { return maps::open_mulran(fuzz::folder().path(), {}); });
  if (!contents) return 0;
  fuzz::require(contents->T_map_lidar.size() == contents->scan_files.size() &&
                    contents->stamps_ns.size() == contents->scan_files.size(),
                "a pose and a stamp for each scan");
  for (const Eigen::Isometry3d& T : contents->T_map_lidar)
    fuzz::require(T.matrix().allFinite(), "poses are finite");
  return 0;
}

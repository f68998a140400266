// `imu.csv` of a drive.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/imu.hpp>

#include <algorithm>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  const std::filesystem::path file = fuzz::put("imu.csv", fuzz::text_of(data, size));
  static_cast<void>(maps::has_imu_columns(file));
  auto readings = fuzz::taken<maps::InputError>([&] { return maps::read_imu_csv(file, 1000); });
  if (!readings) return 0;
  fuzz::require(readings->size() <= 1000, "readings are bounded");
  std::vector<std::string> notes;
  const auto usable = maps::usable_readings(*std::move(readings), "imu.csv", notes);
  if (!usable) return 0;
  for (std::size_t i = 0; i < usable->size(); ++i) {
    const maps::ImuReading& reading = (*usable)[i];
    fuzz::require(reading.rate_radps.allFinite() && reading.force_mps2.allFinite(),
                  "readings are finite");
    fuzz::require(i == 0 || reading.stamp_ns > (*usable)[i - 1].stamp_ns, "stamps increase");
  }
  return 0;
}

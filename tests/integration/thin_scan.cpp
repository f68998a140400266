// A raw scan as `application/vnd.stillmap.scan`, by the header that clients share with the server.
// usage: thin_scan FILE 3|4|5 exact|compact OWN_VEHICLE_M >OUT     numbers a point; the fifth is
// the time
#include <stillmap/localization/thin_scan.hpp>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

int main(int count, char** words) {
  using namespace stillmap::localization;
  if (count != 5) return 2;
  std::ifstream file(words[1], std::ios::binary);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
  const auto stride = static_cast<std::size_t>(std::atoi(words[2])) * sizeof(float);
  ScanView view;
  view.xyz = bytes.data();
  view.xyz_stride_bytes = stride;
  view.size = bytes.size() / stride;
  if (stride == 5 * sizeof(float)) {
    view.time_s = bytes.data() + 4 * sizeof(float);
    view.time_stride_bytes = stride;
  }
  const ThinProfile profile =
      std::string(words[3]) == "exact" ? ThinProfile::kExact : ThinProfile::kCompact;
  const std::vector<char> thin = encode_thin_scan(view, profile, std::atof(words[4]));
  return std::fwrite(thin.data(), 1, thin.size(), stdout) == thin.size() ? 0 : 1;
}

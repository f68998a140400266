#include "exports/crs_text.hpp"

#include <fmt/format.h>

namespace stillmap::maps {

std::string utm_wkt(UtmZone zone) {
  return fmt::format(
      R"(PROJCS["WGS 84 / UTM zone {}{}",GEOGCS["WGS 84",DATUM["WGS_1984",)"
      R"(SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],)"
      R"(AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],)"
      R"(UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]],)"
      R"(PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],)"
      R"(PARAMETER["central_meridian",{}],PARAMETER["scale_factor",0.9996],)"
      R"(PARAMETER["false_easting",500000],PARAMETER["false_northing",{}],)"
      R"(UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],)"
      R"(AXIS["Northing",NORTH],AUTHORITY["EPSG","{}"]])",
      zone.number, zone.north ? "N" : "S", 6 * zone.number - 183, zone.north ? 0 : 10'000'000,
      zone.epsg());
}

std::string local_wkt(std::string_view frame_id, bool enu) {
  // A quote would end the name, and a record of LAS holds 64 KiB.
  constexpr std::size_t kMost = 128;
  std::string name(frame_id.substr(0, kMost));
  for (char& c : name)
    if (c == '"') c = '\'';
  return fmt::format(
      R"(LOCAL_CS["{0}",LOCAL_DATUM["{0}",32767],UNIT["metre",1,AUTHORITY["EPSG","9001"]],)"
      R"(AXIS["x",{1}],AXIS["y",{2}],AXIS["z",{3}]])",
      name, enu ? "EAST" : "OTHER", enu ? "NORTH" : "OTHER", enu ? "UP" : "OTHER");
}

}  // namespace stillmap::maps

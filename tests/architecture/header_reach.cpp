#include <stillmap/maps/scan_file.hpp>
#ifdef STILLMAP_REACH_PRIVATE
#include "formats/pcd.hpp"  // private to maps/
#endif

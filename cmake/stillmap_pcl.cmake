# PCL by its component libraries. `libpcl-dev` would drag in VTK and Qt (2.7 GB), so `./dev` unpacks that package's
# headers into build/pcl and the libraries come from libpcl-registration1.13 and its few friends. An installed
# libpcl-dev is found as well.
find_path(STILLMAP_PCL_INCLUDE pcl/point_types.h REQUIRED
  HINTS ${PROJECT_SOURCE_DIR}/build/pcl/usr/include/pcl-1.13 PATHS /usr/include/pcl-1.13)
find_package(Boost 1.74 REQUIRED)
add_library(stillmap_pcl INTERFACE)
target_include_directories(stillmap_pcl SYSTEM INTERFACE ${STILLMAP_PCL_INCLUDE})
foreach(component registration filters search kdtree octree sample_consensus common)
  find_library(STILLMAP_PCL_${component} NAMES libpcl_${component}.so.1.13 REQUIRED)
  target_link_libraries(stillmap_pcl INTERFACE ${STILLMAP_PCL_${component}})
endforeach()
target_link_libraries(stillmap_pcl INTERFACE Eigen3::Eigen Boost::headers lz4)

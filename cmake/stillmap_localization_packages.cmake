# What maps and localization are built with, for the whole project and for the Python package alone.
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(nlohmann_json REQUIRED)
find_package(OpenSSL REQUIRED)
find_package(fmt REQUIRED)
find_package(SQLite3 3.40 REQUIRED)
list(APPEND CMAKE_MODULE_PATH /usr/share/cmake/geographiclib)
find_package(GeographicLib REQUIRED)
find_package(nanoflann 1.4 REQUIRED)
# Of MRPT only the module of poses and what it needs.
find_package(mrpt-poses REQUIRED)
find_package(PkgConfig REQUIRED)
# Compressions of bags, and their CRC-32.
pkg_check_modules(liblz4 REQUIRED IMPORTED_TARGET liblz4>=1.9)
pkg_check_modules(libzstd REQUIRED IMPORTED_TARGET libzstd>=1.5)
find_package(ZLIB REQUIRED)
find_package(BZip2 REQUIRED)
pkg_check_modules(libhwy REQUIRED IMPORTED_TARGET libhwy)
